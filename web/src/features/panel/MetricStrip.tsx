import { Badge, Group, Text, Tooltip, UnstyledButton } from "@mantine/core";
import { useTranslation } from "react-i18next";
import type { Metric } from "@/shared/api/types";
import { Busy } from "@/shared/ui/Busy";
import { MetricValue } from "@/shared/ui/MetricValue";
import { formatNumber } from "@/shared/units/format";
import { holds, type PanelGoal } from "@/shared/responses/goals";
import classes from "./MetricStrip.module.css";

interface Props {
  names: string[];
  current: Record<string, Metric>;
  reference: Record<string, Metric> | null;
  /** Values have moved on since these were measured. */
  stale: boolean;
  selected: string;
  goals: PanelGoal[];
  onSelect(name: string): void;
}

/** The numbers of the moving curve with their change against the reference; the chosen one colours the sliders. */
export function MetricStrip({ names, current, reference, stale, selected, goals, onSelect }: Props) {
  const { t } = useTranslation();
  return (
    <Group gap={6} role="group" aria-label={t("panel.metrics")} data-testid="metrics" data-stale={stale} className={classes.strip}>
      {names.map((name) => {
        const metric = current[name];
        const before = reference?.[name]?.value;
        const goal = goals.find((one) => one.metric === name);
        const met = goal ? holds(goal, metric?.value) : null;
        const delta = metric?.value != null && before != null && before !== 0 ? (metric.value - before) / Math.abs(before) : null;
        return (
          <Tooltip key={name} label={metric?.advice ?? t("panel.select", { metric: t(`metrics.${name}`, name.replaceAll("_", " ")) })} multiline maw={340}>
            <UnstyledButton className={classes.tile} aria-pressed={name === selected} onClick={() => onSelect(name)}>
              <Text span fz="xs" c="dimmed" display="block">
                {t(`metrics.${name}`, name.replaceAll("_", " "))}
                {met !== null && (
                  <span className={classes.verdict} data-met={met} title={t(met ? "panel.goalMet" : "panel.goalMissed")}>
                    {met ? " ✓" : " ✗"}
                  </span>
                )}
              </Text>
              <Text span className="numbers" fz="sm" fw={600} data-metric={name}>
                {metric?.value != null ? (
                  <MetricValue kind={name} metric={isNoise(name, metric.value, current) ? { ...metric, value: 0 } : metric} />
                ) : metric ? (
                  <Badge variant="outline" color="orange" size="sm" tt="none" autoContrast>
                    {t(`verdicts.${metric.verdict}`, metric.verdict)}
                  </Badge>
                ) : (
                  "…"
                )}
              </Text>
              {delta !== null && Math.abs(delta) > 5e-5 && (
                <Text span fz="xs" className="numbers" ml={6}>
                  {delta > 0 ? "▲" : "▼"} {formatNumber(Math.abs(delta) * 100, 3)} %
                </Text>
              )}
            </UnstyledButton>
          </Tooltip>
        );
      })}
      {stale && <Busy corner>{t("panel.measuring")}</Busy>}
    </Group>
  );
}

/** An error that is only the last digits of the numbers that it is the difference of. */
function isNoise(name: string, value: number, { peak }: Record<string, Metric>): boolean {
  return name === "steady_state_error" && Math.abs(value) < 1e-9 * Math.abs(peak?.value ?? 0);
}
