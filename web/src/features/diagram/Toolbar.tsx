import { Anchor, Breadcrumbs, Button, Group, Text } from "@mantine/core";
import { useTranslation } from "react-i18next";
import classes from "./DiagramPage.module.css";
import type { Check } from "./useCheck";
import type { useSaving } from "./useSaving";

interface Props {
  root: string;
  scope: readonly string[];
  check: Check;
  saving: ReturnType<typeof useSaving>;
  frames: boolean;
  grouping: boolean;
  canUndo: boolean;
  canRedo: boolean;
  onGo(scope: readonly string[]): void;
  onUndo(): void;
  onRedo(): void;
  onArrange(): void;
  onFrames(): void;
  onGroup(): void;
  onAdd(): void;
}

/** Where one is, how it stands, and what can be done with all of it. */
export function Toolbar({ root, scope, check, saving, frames, grouping, canUndo, canRedo, onGo, onUndo, onRedo, onArrange, onFrames, onGroup, onAdd }: Props) {
  const { t } = useTranslation();
  const state = !check.complete ? t("diagram.incomplete") : check.problem ? t("diagram.wrong") : check.error ? check.error.message : saving.dirty ? t("diagram.unsaved") : t("diagram.fine");
  return (
    <div className={classes.bar}>
      <Breadcrumbs separator="›" component="nav" aria-label={t("diagram.where")}>
        {[root, ...scope].map((name, i) =>
          i === scope.length ? (
            <Text key={i} fz="sm" fw={600} aria-current="page">
              {name}
            </Text>
          ) : (
            <Anchor key={i} component="button" fz="sm" onClick={() => onGo(scope.slice(0, i))}>
              {name}
            </Anchor>
          ),
        )}
      </Breadcrumbs>
      <Group gap={6}>
        <Text span fz="xs" role="status" data-testid="check" data-pending={check.pending}>
          {state}
        </Text>
        <Button variant="default" onClick={onAdd} disabled={frames} aria-keyshortcuts="A" title="A">
          {t("diagram.add")}
        </Button>
        <Button variant="default" onClick={onGroup} disabled={!grouping} aria-keyshortcuts="Control+G" title="Ctrl+G">
          {t("diagram.group")}
        </Button>
        <Button variant={frames ? "light" : "default"} onClick={onFrames} aria-pressed={frames} aria-keyshortcuts="F" title="F">
          {t("diagram.frames")}
        </Button>
        <Button variant="default" onClick={onArrange} disabled={frames} aria-keyshortcuts="L" title="L">
          {t("diagram.arrange")}
        </Button>
        <Button variant="default" onClick={onUndo} disabled={!canUndo} aria-keyshortcuts="Control+Z" title="Ctrl+Z">
          {t("diagram.undo")}
        </Button>
        <Button variant="default" onClick={onRedo} disabled={!canRedo} aria-keyshortcuts="Control+Shift+Z" title="Ctrl+Shift+Z">
          {t("diagram.redo")}
        </Button>
        <Button onClick={saving.save} disabled={!saving.dirty} loading={saving.saving} aria-keyshortcuts="Control+S" title="Ctrl+S">
          {t("diagram.save")}
        </Button>
      </Group>
    </div>
  );
}
