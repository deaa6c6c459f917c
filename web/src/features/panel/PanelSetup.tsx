import { Button, Group, MultiSelect, Popover, Select, Stack } from "@mantine/core";
import { useTranslation } from "react-i18next";
import type { Opened } from "@/shared/live/protocol";
import { ruleAndValue } from "@/shared/forms/faults";
import { PlainEntry } from "@/shared/ui/PlainEntry";
import { words } from "@/shared/units/format";
import { mainOutput, MEASURABLE, usualMetrics, type PanelState } from "./state";

interface Props {
  state: PanelState;
  opened: Opened;
  loops: string[];
  plots: string[];
  onChange(change: Partial<PanelState>): void;
}

const CLOSED = "path";

/** What is commanded, looked at and drawn. */
export function PanelSetup({ state, opened, loops, plots, onChange }: Props) {
  const { t } = useTranslation();
  const output = mainOutput(state, opened);
  const input = state.input ?? opened.inputs[0] ?? "";
  const choices = [
    ...opened.curves.map((name) => ({ value: `step:${name}`, label: t("panel.stepOf", { output: words(name) }) })),
    ...opened.curves.map((name) => ({ value: `spectrum:${name}`, label: t("panel.spectrumOf", { output: words(name) }) })),
    { value: "bode", label: t("panel.magnitude") },
    { value: "phase", label: t("panel.phase") },
    { value: "nyquist", label: t("panel.nyquist") },
    { value: "poles", label: t("panel.poles") },
  ];
  return (
    <Group gap="xs" align="flex-end">
      <Select label={t("panel.input")} data={opened.inputs} value={input} onChange={(value) => onChange({ input: value })} w={130} />
      <PlainEntry label={t("panel.amplitude")} value={state.amplitude} refuse={(value) => (value === 0 ? ruleAndValue(t, "forms.notZero", value) : undefined)} onCommit={(value) => value !== undefined && onChange({ amplitude: value })} w={90} />
      <Select label={t("panel.output")} data={opened.outputs.map((o) => ({ value: o.name, label: words(o.name) }))} value={output} onChange={(value) => onChange({ output: value })} w={150} />
      <Select
        label={t("panel.frequency")}
        data={[{ value: CLOSED, label: t("panel.pathOf", { input, output: words(output) }) }, ...loops.map((loop) => ({ value: loop, label: t("panel.loopAt", { loop }) }))]}
        value={state.loop ?? CLOSED}
        onChange={(value) => onChange(value === CLOSED ? { loop: null, path: [input, output] } : { loop: value, path: null })}
        w={210}
      />
      <PlainEntry label={t("panel.duration")} unit="s" value={state.duration ?? undefined} optional placeholder={t("panel.auto")} refuse={(value) => (value > 0 ? undefined : ruleAndValue(t, "forms.positive", value))} onCommit={(value) => onChange({ duration: value ?? null })} w={90} />
      <Popover width={320} position="bottom-start" withinPortal>
        <Popover.Target>
          <Button variant="default">{t("panel.arrange")}</Button>
        </Popover.Target>
        <Popover.Dropdown>
          <Stack gap="sm">
            <MultiSelect label={t("panel.plots")} data={choices} value={plots} onChange={(value) => onChange({ plots: value })} comboboxProps={{ withinPortal: false }} />
            <MultiSelect label={t("panel.metrics")} data={MEASURABLE.map((name) => ({ value: name, label: t(`metrics.${name}`, words(name)) }))} value={state.metrics ?? usualMetrics(loops)} onChange={(value) => onChange({ metrics: value })} comboboxProps={{ withinPortal: false }} />
            <MultiSelect
              label={t("panel.sliders")}
              data={opened.parameters.filter((p) => !p.bound).map((p) => p.path)}
              value={state.sliders}
              onChange={(value) => onChange({ sliders: value })}
              searchable
              maxValues={20}
              comboboxProps={{ withinPortal: false }}
            />
          </Stack>
        </Popover.Dropdown>
      </Popover>
    </Group>
  );
}
