import { Button, CloseButton, Group, Select, TextInput } from "@mantine/core";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import type { LiveParameter } from "@/shared/live/protocol";
import { withUnit } from "@/shared/units/format";
import { readEntry } from "@/shared/units/number";
import classes from "@/shared/ui/Chip.module.css";
import type { PanelState } from "./state";

interface Props {
  state: PanelState;
  parameters: Map<string, LiveParameter>;
  onChange(change: Partial<PanelState>): void;
  onPin(): void;
}

const MOST = 8;

/** One parameter at several values, each a chip and a curve; and the reference that everything is compared with. */
export function CompareBar({ state, parameters, onChange, onPin }: Props) {
  const { t } = useTranslation();
  const [text, setText] = useState("");
  const [wrong, setWrong] = useState(false);
  const path = state.compare?.path ?? state.sliders[0] ?? null;
  const parameter = path ? parameters.get(path) : undefined;
  const values = state.compare?.values ?? [];
  const add = () => {
    const entries = text.split(/[;\s](?=[\d.+-])|;/).filter((part) => part.trim() !== "").map((part) => readEntry(part, parameter?.unit));
    if (entries.length === 0 || entries.some((entry) => entry.kind !== "number")) return setWrong(true);
    setWrong(false);
    setText("");
    const added = entries.flatMap((entry) => (entry.kind === "number" ? [entry.value] : []));
    if (path) onChange({ compare: { path, values: [...new Set([...values, ...added])].slice(0, MOST) } });
  };
  const drop = (value: number) => {
    const rest = values.filter((v) => v !== value);
    onChange({ compare: rest.length > 0 && path ? { path, values: rest } : null });
  };
  return (
    <Group gap="xs" align="center" role="group" aria-label={t("panel.compare")}>
      <Select aria-label={t("panel.compareWhat")} data={state.sliders} value={path} onChange={(value) => value && onChange({ compare: values.length > 0 ? { path: value, values: [] } : state.compare && null })} w={160} disabled={values.length > 0} placeholder={t("panel.compareWhat")} />
      <form
        onSubmit={(event) => {
          event.preventDefault();
          add();
        }}
      >
        <TextInput aria-label={t("panel.compareAt")} placeholder={t("panel.compareHint")} value={text} onChange={(event) => setText(event.currentTarget.value)} error={wrong} w={130} />
      </form>
      {values.map((value) => (
        <span key={value} className={classes.chip} data-testid="chip">
          {parameter ? withUnit(value, parameter.unit) : value}
          <CloseButton size="xs" aria-label={t("panel.dropCompare", { value })} onClick={() => drop(value)} />
        </span>
      ))}
      {state.reference ? (
        <span className={classes.chip} data-testid="reference">
          {t("panel.reference")}
          <CloseButton size="xs" aria-label={t("panel.unpin")} onClick={() => onChange({ reference: null })} />
        </span>
      ) : (
        <Button variant="default" onClick={onPin}>
          {t("panel.pin")}
        </Button>
      )}
    </Group>
  );
}
