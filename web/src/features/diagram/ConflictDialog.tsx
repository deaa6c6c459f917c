import { Button, Group, List, Modal, Radio, Stack, Table, Text, Title } from "@mantine/core";
import { useMemo, useState } from "react";
import { useTranslation } from "react-i18next";
import type { SystemDocument } from "@/shared/api/types";
import { differences, shownValue, type Change } from "@/shared/systems/difference";
import { merge, type Side } from "./merge";

export interface Conflict {
  base: SystemDocument;
  mine: SystemDocument;
  theirs: SystemDocument;
  etag: string;
}

interface Props {
  conflict: Conflict;
  busy: boolean;
  onClose(): void;
  onMerge(document: SystemDocument): void;
  onTakeTheirs(): void;
}

const MOST = 8;

/** Somebody else has saved meanwhile: what each side changed, a choice where both did, and one document of it. */
export function ConflictDialog({ conflict, busy, onClose, onMerge, onTakeTheirs }: Props) {
  const { t } = useTranslation();
  const [choices, setChoices] = useState<Record<string, Side>>({});
  const { base, mine, theirs } = conflict;
  const { merged, clashes, dropped } = useMemo(() => merge(base, mine, theirs, choices), [base, mine, theirs, choices]);
  const clashing = useMemo(() => new Set(clashes.map((clash) => clash.place)), [clashes]);
  const sides = useMemo(() => [differences(base, theirs), differences(base, mine)] as const, [base, mine, theirs]);
  const undecided = clashes.filter((clash) => choices[clash.place] === undefined).length;
  const list = (title: string, changes: readonly Change[]) => (
    <div>
      <Title order={3} fz="sm">
        {title}
      </Title>
      {changes.length === 0 && <Text fz="sm">{t("conflict.nothing")}</Text>}
      <List size="sm" withPadding>
        {changes.slice(0, MOST).map((change) => (
          <List.Item key={change.place}>
            <span className="numbers">{change.place}</span>: {change.before ?? t("conflict.absent")} → {change.after ?? t("conflict.absent")}
          </List.Item>
        ))}
        {changes.length > MOST && <List.Item>{t("conflict.more", { count: changes.length - MOST })}</List.Item>}
      </List>
    </div>
  );
  const apart = (changes: readonly Change[]) => changes.filter((change) => ![...clashing].some((place) => change.place === place || change.place.startsWith(`${place}.`)));
  return (
    <Modal opened onClose={onClose} title={t("conflict.title")} size="xl" closeButtonProps={{ "aria-label": t("conflict.later") }}>
      <Stack gap="sm">
        {list(t("conflict.they"), apart(sides[0]))}
        {list(t("conflict.you"), apart(sides[1]))}
        {clashes.length > 0 && (
          <div>
            <Title order={3} fz="sm">
              {t("conflict.both")}
            </Title>
            <Table.ScrollContainer minWidth={440}>
              <Table>
                <Table.Thead>
                  <Table.Tr>
                    <Table.Th>{t("revisions.place")}</Table.Th>
                    <Table.Th>{t("conflict.before")}</Table.Th>
                    <Table.Th>{t("conflict.choose")}</Table.Th>
                  </Table.Tr>
                </Table.Thead>
                <Table.Tbody>
                  {clashes.map((clash) => (
                    <Table.Tr key={clash.place}>
                      <Table.Td className="numbers">{clash.place}</Table.Td>
                      <Table.Td className="numbers">{shownOr(clash.base, t("conflict.absent"))}</Table.Td>
                      <Table.Td>
                        <Radio.Group aria-label={clash.place} value={choices[clash.place] ?? null} onChange={(side) => setChoices({ ...choices, [clash.place]: side as Side })}>
                          <Group gap="md">
                            <Radio size="xs" value="mine" label={t("conflict.ofMine", { value: shownOr(clash.mine, t("conflict.absent")) })} />
                            <Radio size="xs" value="theirs" label={t("conflict.ofTheirs", { value: shownOr(clash.theirs, t("conflict.absent")) })} />
                          </Group>
                        </Radio.Group>
                      </Table.Td>
                    </Table.Tr>
                  ))}
                </Table.Tbody>
              </Table>
            </Table.ScrollContainer>
          </div>
        )}
        {dropped.length > 0 && (
          <Text fz="sm" role="note">
            {t("conflict.dropped", { places: dropped.join(", ") })}
          </Text>
        )}
        <Group justify="flex-end">
          <Button variant="default" onClick={onTakeTheirs}>
            {t("conflict.theirs")}
          </Button>
          <Button variant="default" onClick={() => onMerge(mine)} disabled={busy}>
            {t("conflict.mine")}
          </Button>
          <Button onClick={() => onMerge(merged)} disabled={undecided > 0} loading={busy} data-autofocus>
            {undecided > 0 ? t("conflict.undecided", { count: undecided }) : t("conflict.merge")}
          </Button>
        </Group>
      </Stack>
    </Modal>
  );
}

function shownOr(value: unknown, absent: string): string {
  return value === undefined ? absent : shownValue(value);
}
