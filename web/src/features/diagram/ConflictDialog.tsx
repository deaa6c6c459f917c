import { Button, Group, List, Modal, Stack, Text } from "@mantine/core";
import { useTranslation } from "react-i18next";
import type { SystemDocument } from "@/shared/api/types";
import { differences } from "@/shared/systems/difference";
import { merge } from "./merge";

export interface Conflict {
  base: SystemDocument;
  mine: SystemDocument;
  theirs: SystemDocument;
  etag: string;
}

interface Props {
  conflict: Conflict | null;
  onClose(): void;
  onMerge(document: SystemDocument, conflict: Conflict): void;
  onTakeTheirs(conflict: Conflict): void;
}

/** Somebody else has saved meanwhile: what they changed, and the three ways on. */
export function ConflictDialog({ conflict, onClose, onMerge, onTakeTheirs }: Props) {
  const { t } = useTranslation();
  if (!conflict) return null;
  const theirs = differences(conflict.base, conflict.theirs);
  const { merged, conflicts } = merge(conflict.base, conflict.mine, conflict.theirs);
  return (
    <Modal opened onClose={onClose} title={t("conflict.title")} size="lg" closeButtonProps={{ "aria-label": t("conflict.later") }}>
      <Stack gap="sm">
        <Text fz="sm">{t("conflict.doc")}</Text>
        <List size="sm" withPadding>
          {theirs.slice(0, 12).map((change) => (
            <List.Item key={change.place}>
              <span className="numbers">{change.place}</span>: {change.before ?? "–"} → {change.after ?? "–"}
            </List.Item>
          ))}
          {theirs.length > 12 && <List.Item>{t("conflict.more", { count: theirs.length - 12 })}</List.Item>}
        </List>
        {conflicts.length > 0 && (
          <Text fz="sm" role="note">
            {t("conflict.both", { places: conflicts.join(", ") })}
          </Text>
        )}
        <Group justify="flex-end">
          <Button variant="default" onClick={() => onTakeTheirs(conflict)}>
            {t("conflict.theirs")}
          </Button>
          <Button variant="default" onClick={() => onMerge(conflict.mine, conflict)}>
            {t("conflict.mine")}
          </Button>
          <Button onClick={() => onMerge(merged, conflict)} data-autofocus>
            {t("conflict.merge")}
          </Button>
        </Group>
      </Stack>
    </Modal>
  );
}
