import { Button, MultiSelect, Popover, Stack } from "@mantine/core";
import { useTranslation } from "react-i18next";
import type { Opened } from "@/shared/live/protocol";
import { MEASURABLE, usualMetrics } from "@/shared/responses/view";
import { PlotChoice, ViewSetup } from "@/shared/responses/ViewSetup";
import { words } from "@/shared/units/format";
import type { PanelState } from "./state";

interface Props {
  state: PanelState;
  opened: Opened;
  loops: string[];
  plots: string[];
  onChange(change: Partial<PanelState>): void;
}

/** What is commanded, looked at and drawn. */
export function PanelSetup({ state, opened, loops, plots, onChange }: Props) {
  const { t } = useTranslation();
  return (
    <ViewSetup view={state} opened={opened} loops={loops} onChange={onChange}>
      <Popover width={320} position="bottom-start" withinPortal>
        <Popover.Target>
          <Button variant="default">{t("panel.arrange")}</Button>
        </Popover.Target>
        <Popover.Dropdown>
          <Stack gap="sm">
            <PlotChoice inside curves={opened.curves} plots={plots} onChange={(value) => onChange({ plots: value })} />
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
    </ViewSetup>
  );
}
