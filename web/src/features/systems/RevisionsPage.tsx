import { Badge, Button, Checkbox, Group, Select, Stack, Table, Text } from "@mantine/core";
import { keepPreviousData, useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { Link, useParams, useSearchParams } from "react-router";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { When } from "@/shared/ui/When";
import { revisionQuery, revisionsQuery, saveSystem, systemQuery } from "@/shared/api/systems";
import { compareAt, MOST_DESIGNS } from "@/shared/systems/compared";
import { differences } from "@/shared/systems/difference";

const COLORS = { added: "green", removed: "red", changed: "blue" } as const;

/** Every revision of a system, and what any two of them differ in. */
export function RevisionsPage() {
  const { t } = useTranslation();
  const { id = "" } = useParams();
  const queries = useQueryClient();
  const [query, setQuery] = useSearchParams();
  const [chosen, setChosen] = useState<number[]>([]);
  const current = useQuery(systemQuery(id)).data!;
  const revisions = useQuery(revisionsQuery(id));
  const after = Number(query.get("to") ?? current.revision);
  const before = Number(query.get("from") ?? Math.max(1, after - 1));
  // What is below the differences stays while two others are compared: only one of the two changes at a time.
  const first = useQuery({ ...revisionQuery(id, before), placeholderData: keepPreviousData });
  const second = useQuery({ ...revisionQuery(id, after), placeholderData: keepPreviousData });
  const restore = useMutation({
    mutationFn: async () => saveSystem(id, await queries.ensureQueryData(revisionQuery(id, before)), current.etag),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["system", id] }),
  });
  const numbers = (revisions.data?.items ?? []).map((row) => String(row.revision));
  const changes = first.data && second.data ? differences(first.data, second.data) : undefined;
  return (
    <div className="page">
      <Stack gap="md">
        <ProblemAlert error={revisions.error ?? first.error ?? second.error ?? restore.error} />
        <Group align="flex-end">
          <Select label={t("revisions.from")} data={numbers} value={String(before)} onChange={(value) => setQuery({ from: value!, to: String(after) }, { replace: true, preventScrollReset: true })} w={140} />
          <Select label={t("revisions.to")} data={numbers} value={String(after)} onChange={(value) => setQuery({ from: String(before), to: value! }, { replace: true, preventScrollReset: true })} w={140} />
          <Button variant="default" onClick={() => restore.mutate()} disabled={before === current.revision} loading={restore.isPending}>
            {t("revisions.restore", { number: before })}
          </Button>
        </Group>
        {changes && changes.length === 0 && <Text fz="sm">{before === after ? t("revisions.same") : t("revisions.nothing")}</Text>}
        {changes && changes.length > 0 && (
          <Table data-testid="difference">
            <Table.Thead>
              <Table.Tr>
                <Table.Th>{t("revisions.place")}</Table.Th>
                <Table.Th>{t("revisions.kind")}</Table.Th>
                <Table.Th>{t("revisions.before")}</Table.Th>
                <Table.Th>{t("revisions.after")}</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {changes.map((change) => (
                <Table.Tr key={change.place}>
                  <Table.Td className="numbers">{change.place}</Table.Td>
                  <Table.Td>
                    <Badge variant="outline" color={COLORS[change.kind]} tt="none" autoContrast>
                      {t(`revisions.${change.kind}`)}
                    </Badge>
                  </Table.Td>
                  <Table.Td className="numbers">{change.before}</Table.Td>
                  <Table.Td className="numbers">{change.after}</Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        )}
        {/* below what differs, whose height is not known before it is there */}
        {revisions.data && (changes || first.error || second.error) && (
          <>
            <Button component={Link} to={compareAt(chosen.toSorted((a, b) => a - b).map((revision) => ({ kind: "revision", id, revision })))} variant="default" style={{ alignSelf: "flex-start" }}>
              {t("compare.chosen", { count: chosen.length })}
            </Button>
            <Table>
              <Table.Caption>{t("revisions.all")}</Table.Caption>
              <Table.Thead>
                <Table.Tr>
                  <Table.Th w={40} aria-label={t("compare.choose")} />
                  <Table.Th>{t("systems.revision")}</Table.Th>
                  <Table.Th>{t("revisions.made")}</Table.Th>
                </Table.Tr>
              </Table.Thead>
              <Table.Tbody>
                {revisions.data.items.map((row) => (
                  <Table.Tr key={row.revision}>
                    <Table.Td>
                      <Checkbox size="xs" aria-label={t("compare.chooseOne", { name: t("system.revision", { number: row.revision }) })} checked={chosen.includes(row.revision)} disabled={chosen.length >= MOST_DESIGNS && !chosen.includes(row.revision)} onChange={(event) => setChosen(event.currentTarget.checked ? [...chosen, row.revision] : chosen.filter((one) => one !== row.revision))} />
                    </Table.Td>
                    <Table.Td className="numbers">{row.revision}</Table.Td>
                    <Table.Td>
                      <When at={row.created_at} />
                    </Table.Td>
                  </Table.Tr>
                ))}
              </Table.Tbody>
            </Table>
          </>
        )}
      </Stack>
    </div>
  );
}
