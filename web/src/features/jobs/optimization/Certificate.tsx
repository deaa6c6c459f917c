import { Text } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { DataTable } from "@/shared/ui/DataTable";
import { formatMetric, formatNumber, withUnit, words } from "@/shared/units/format";
import type { OptimizationResult, Proof } from "../results";

/** Every goal at the optimum once more: by the exact engine, in another way where there is one, in the scenario that counts. */
export function Certificate({ result }: { result: OptimizationResult }) {
  const { t } = useTranslation();
  const { certificate, goals } = result;
  const scenarios = new Set(certificate.goals.map(({ scenario }) => scenario)).size > 1 || certificate.goals.some(({ scenario }) => scenario > 0);
  const shown = (proof: Proof, value: number | null | undefined) => {
    const goal = goals[proof.goal];
    if (value == null || !goal) return "–";
    const text = formatMetric(goal.metric, value, goal.after.unit);
    return text.unit ? `${text.text} ${text.unit}` : text.text;
  };
  const where = ({ at }: Proof) => (at?.time != null ? `t = ${withUnit(at.time, "s")}` : at?.frequency != null ? `ω = ${withUnit(at.frequency, "rad/s")}` : "–");
  return (
    <div data-testid="certificate" data-valid={certificate.valid}>
      <Text fz="sm" mt="xs">
        <b>{certificate.valid ? "✓" : "✗"}</b> {certificate.valid ? t("jobs.certified") : t("jobs.notCertified", { violation: formatNumber(certificate.worst_violation ?? Infinity, 3) })} {t("jobs.effort", { evaluations: result.evaluations, seconds: formatNumber(result.seconds, 3) })}
      </Text>
      <details style={{ fontSize: "0.875rem" }}>
        <summary>{t("jobs.proof")}</summary>
        <DataTable
          testId="proof"
          label={t("jobs.proof")}
          maxWidth={960}
          rows={certificate.goals}
          keyOf={(proof) => `${proof.goal}|${proof.scenario}`}
          columns={[
            { title: t("influence.metric"), cell: ({ goal }) => t(`metrics.${goals[goal]?.metric}`, words(goals[goal]?.metric ?? "")) },
            { title: t("jobs.exact"), numeric: true, cell: (proof) => shown(proof, proof.value) },
            { title: t("jobs.independent"), numeric: true, cell: (proof) => shown(proof, proof.independent) },
            { title: t("jobs.violation"), numeric: true, cell: ({ violation }) => (violation === null ? "–" : formatNumber(violation, 3)) },
            { title: t("jobs.where"), cell: where },
            ...(scenarios ? [{ title: t("jobs.scenario"), numeric: true, cell: ({ scenario, scenario_name }: Proof) => scenario_name ?? (scenario === 0 ? t("jobs.nominal") : scenario) }] : []),
          ]}
        />
      </details>
    </div>
  );
}
