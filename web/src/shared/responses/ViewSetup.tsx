import { Group, MultiSelect, Select } from "@mantine/core";
import type { ReactNode } from "react";
import { useTranslation } from "react-i18next";
import { ruleAndValue } from "@/shared/forms/faults";
import type { Opened } from "@/shared/live/protocol";
import { PlainEntry } from "@/shared/ui/PlainEntry";
import { words } from "@/shared/units/format";
import { mainOutput, type View } from "./view";

interface Props {
  view: View;
  opened: Pick<Opened, "inputs" | "outputs">;
  loops: string[];
  onChange(change: Partial<View>): void;
  children?: ReactNode;
}

const CLOSED = "path";

/** What is commanded and looked at. */
export function ViewSetup({ view, opened, loops, onChange, children }: Props) {
  const { t } = useTranslation();
  const output = mainOutput(view, opened);
  const input = view.input ?? opened.inputs[0] ?? "";
  return (
    <Group gap="xs" align="flex-end">
      <Select label={t("panel.input")} data={opened.inputs} value={input} onChange={(value) => onChange({ input: value })} w={130} />
      <PlainEntry label={t("panel.amplitude")} value={view.amplitude} refuse={(value) => (value === 0 ? ruleAndValue(t, "forms.notZero", value) : undefined)} onCommit={(value) => value !== undefined && onChange({ amplitude: value })} w={90} />
      <Select label={t("panel.output")} data={opened.outputs.map((o) => ({ value: o.name, label: words(o.name) }))} value={output} onChange={(value) => onChange({ output: value })} w={150} />
      <Select
        label={t("panel.frequency")}
        data={[{ value: CLOSED, label: t("panel.pathOf", { input, output: words(output) }) }, ...loops.map((loop) => ({ value: loop, label: t("panel.loopAt", { loop }) }))]}
        value={view.loop ?? CLOSED}
        onChange={(value) => onChange(value === CLOSED ? { loop: null, path: [input, output] } : { loop: value, path: null })}
        w={210}
      />
      <PlainEntry label={t("panel.duration")} unit="s" value={view.duration ?? undefined} optional placeholder={t("panel.auto")} refuse={(value) => (value > 0 ? undefined : ruleAndValue(t, "forms.positive", value))} onCommit={(value) => onChange({ duration: value ?? null })} w={90} />
      {children}
    </Group>
  );
}

/** Which plots are drawn, in which order. */
export function PlotChoice({ curves, plots, onChange, inside = false }: { curves: string[]; plots: string[]; onChange(plots: string[]): void; /** Of another popover. */ inside?: boolean }) {
  const { t } = useTranslation();
  const choices = [
    ...curves.map((name) => ({ value: `step:${name}`, label: t("panel.stepOf", { output: words(name) }) })),
    ...curves.map((name) => ({ value: `spectrum:${name}`, label: t("panel.spectrumOf", { output: words(name) }) })),
    { value: "bode", label: t("panel.magnitude") },
    { value: "phase", label: t("panel.phase") },
    { value: "nyquist", label: t("panel.nyquist") },
    { value: "nichols", label: t("panel.nichols") },
    { value: "poles", label: t("panel.poles") },
  ];
  return <MultiSelect label={t("panel.plots")} data={choices} value={plots} onChange={onChange} comboboxProps={{ withinPortal: !inside }} />;
}
