import { Button, Group, Modal, NumberInput, Stack, Text } from "@mantine/core";
import { useMutation, useQueryClient } from "@tanstack/react-query";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { api, must } from "@/shared/api/client";
import { isProblem } from "@/shared/api/problem";
import { DataTable } from "@/shared/ui/DataTable";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { When } from "@/shared/ui/When";
import { keysQuery, type Key, type NewKey } from "./api";

const HOUR = 3600;
/** Hours: for 30 days the service keeps an old key open. */
const LONGEST = 720;

/** Whether a key opens nothing any more: revoked, or past its end, as one is that was replaced at once. */
function isOver({ revoked_at, expires_at }: Key): boolean {
  return revoked_at !== null || (expires_at !== null && Date.parse(expires_at) <= Date.now());
}

/** Every key of the workspace; one may be replaced, the old one opening for a while yet, or revoked at once. */
export function KeyTable({ keys, onMade }: { keys: Key[]; onMade(made: NewKey): void }) {
  const { t } = useTranslation();
  const queries = useQueryClient();
  const [rotated, setRotated] = useState<Key | null>(null);
  const [hours, setHours] = useState<number | string>(1);
  const refresh = () => queries.invalidateQueries({ queryKey: keysQuery.queryKey });
  const revoke = useMutation({ mutationFn: (identifier: string) => must(api.DELETE("/v1/keys/{identifier}", { params: { path: { identifier } } })), onSuccess: refresh });
  const rotate = useMutation({
    mutationFn: (identifier: string) => must(api.POST("/v1/keys/{identifier}/rotate", { params: { path: { identifier } }, body: { overlap: Number(hours) * HOUR } })),
    onSuccess: (made) => {
      onMade(made);
      setRotated(null);
      return refresh();
    },
  });
  const problem = isProblem(rotate.error) ? rotate.error : null;
  // The service counts in seconds: its rule is told in what is filled in.
  const tooLong = Number(hours) > LONGEST ? t("forms.got", { rule: t("forms.atMost", { limit: `${LONGEST} h` }), value: `${hours} h` }) : undefined;
  const close = () => {
    setRotated(null);
    rotate.reset();
  };
  return (
    <>
      <ProblemAlert error={revoke.error} />
      <DataTable
        testId="keys"
        minWidth={640}
        rows={keys}
        keyOf={(key) => key.id}
        columns={[
          { title: t("access.name"), cell: (key) => key.name },
          { title: t("access.begins"), cell: (key) => <span className="numbers">{key.prefix}…</span> },
          { title: t("access.may"), cell: (key) => key.scopes.map((scope) => t(`access.scopes.${scope}`)).join(", ") },
          { title: t("access.used"), cell: (key) => <When at={key.last_used_at} /> },
          { title: t("access.ends"), cell: (key) => (key.revoked_at ? t("access.revoked") : <When at={key.expires_at} />) },
          {
            title: "",
            cell: (key) =>
              !isOver(key) && (
                <Group gap={4} justify="flex-end" wrap="nowrap">
                  <Button variant="subtle" size="compact-xs" onClick={() => setRotated(key)} aria-label={t("access.rotateOf", { name: key.name })}>
                    {t("access.rotate")}
                  </Button>
                  <Button variant="subtle" color="red" size="compact-xs" onClick={() => revoke.mutate(key.id)} aria-label={t("access.revokeOf", { name: key.name })}>
                    {t("access.revoke")}
                  </Button>
                </Group>
              ),
          },
        ]}
      />
      <Modal opened={rotated !== null} onClose={close} title={t("access.rotateOf", { name: rotated?.name ?? "" })} closeButtonProps={{ "aria-label": t("datasets.close") }}>
        <Stack gap="sm">
          <Text fz="sm">{t("access.rotateDoc")}</Text>
          <NumberInput size="xs" label={t("access.overlap")} description={t("access.overlapDoc")} suffix=" h" min={0} hideControls value={hours} onChange={setHours} error={tooLong ?? problem?.at("/overlap")} data-autofocus />
          <ProblemAlert error={rotate.error} shown={["/overlap"]} />
          <Group>
            <Button onClick={() => rotated && rotate.mutate(rotated.id)} loading={rotate.isPending} disabled={hours === "" || tooLong !== undefined}>
              {t("access.rotateGo")}
            </Button>
          </Group>
        </Stack>
      </Modal>
    </>
  );
}
