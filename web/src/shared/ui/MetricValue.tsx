import { Text } from "@mantine/core";
import { useTranslation } from "react-i18next";
import type { Metric } from "@/shared/api/types";
import { formatMetric } from "@/shared/units/format";

/** A metric in the unit of its field; without a value the word that says why, and beside one the word for what is left open. */
export function MetricValue({ kind, metric }: { kind: string; metric: Metric }) {
  const { t } = useTranslation();
  const word = t(`verdicts.${metric.verdict}`, metric.verdict);
  if (metric.value === null) return word;
  const shown = formatMetric(kind, metric.value, metric.unit);
  const doubt = metric.doubt == null ? null : formatMetric(kind, metric.doubt, metric.unit);
  return (
    <>
      {shown.text} {shown.unit}
      {metric.verdict !== "ok" && (
        <Text span fz="xs" fw={400} c="dimmed">
          {doubt && ` ± ${doubt.text} ${doubt.unit}`} ({word})
        </Text>
      )}
    </>
  );
}
