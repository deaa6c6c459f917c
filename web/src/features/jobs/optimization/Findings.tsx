import { Group, List, Text, Title } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { DataTable } from "@/shared/ui/DataTable";
import { formatNumber, words } from "@/shared/units/format";
import type { OptimizationResult } from "../results";

const share = (part: number | null) => (part === null ? "–" : `${formatNumber(100 * part, 3)} %`);

/** What else a search found out: goals that stand against each other, what each variable still moves, other methods, other structures, and how sure it all is. */
export function Findings({ result }: { result: OptimizationResult }) {
  const { t } = useTranslation();
  const { goals, conflict = [], cross_check = [], alternatives = [], robustness, chosen } = result;
  const name = (goal: number) => t(`metrics.${goals[goal]?.metric}`, words(goals[goal]?.metric ?? ""));
  const variables = Object.keys(result.best).filter((path) => goals.some((goal) => goal.elasticities?.[path] != null));
  const yielded = result.yield;
  return (
    <>
      {conflict.length > 0 && (
        <section data-testid="conflict">
          <Title order={2}>{t("jobs.conflict")}</Title>
          <List size="sm">
            {conflict.map((one) => (
              <List.Item key={one.goal}>{t("jobs.conflictShare", { goal: name(one.goal), share: share(one.share) })}</List.Item>
            ))}
          </List>
        </section>
      )}
      {variables.length > 0 && (
        <section>
          <Title order={2}>{t("jobs.elasticities")}</Title>
          <Text fz="sm" c="dimmed" mb="xs">
            {t("jobs.elasticitiesDoc")}
          </Text>
          <DataTable
            testId="elasticities"
            maxWidth={960}
            rows={goals}
            keyOf={(_, i) => String(i)}
            columns={[
              { title: t("influence.metric"), cell: (_, i) => name(i) },
              ...variables.map((path) => ({ title: path, numeric: true, cell: (goal: (typeof goals)[number]) => (goal.elasticities?.[path] == null ? "–" : formatNumber(goal.elasticities[path], 3)) })),
            ]}
          />
        </section>
      )}
      {(yielded || robustness) && (
        <section data-testid="robust">
          <Title order={2}>{t("jobs.robust")}</Title>
          {yielded && <Text fz="sm">{t("jobs.yield", { share: share(yielded.share), low: share(yielded.lower95), high: share(yielded.upper95), samples: yielded.samples })}</Text>}
          {robustness && (
            <Group gap="xs">
              <Text fz="sm">
                {t(robustness.worst.violation !== null && robustness.worst.violation > 1e-6 ? "jobs.worstMissed" : "jobs.worstMet", {
                  place: Object.entries(robustness.worst.parameters)
                    .map(([path, value]) => `${path} = ${formatNumber(value)}`)
                    .join(", "),
                })}
              </Text>
            </Group>
          )}
        </section>
      )}
      {alternatives.length > 0 && (
        <section>
          <Title order={2} mb="xs">
            {t("jobs.structures")}
          </Title>
          <DataTable
            testId="structures"
            maxWidth={760}
            rows={alternatives}
            keyOf={(one) => one.name}
            columns={[
              { title: t("jobs.structure"), cell: (one) => <b style={{ fontWeight: one.name === chosen ? 700 : 400 }}>{one.name === chosen ? `${one.name} ★` : one.name}</b> },
              { title: t("jobs.status"), cell: (one) => t(`jobs.outcome.${one.status}`, one.status) },
              { title: t("jobs.objective"), numeric: true, cell: (one) => (one.objective === null ? "–" : formatNumber(one.objective)) },
              { title: t("jobs.allMet"), cell: (one) => (one.certificate.valid ? "✓" : "✗") },
            ]}
          />
        </section>
      )}
      {cross_check.length > 0 && (
        <section>
          <Title order={2} mb="xs">
            {t("jobs.checked")}
          </Title>
          <DataTable
            testId="checked"
            maxWidth={760}
            rows={cross_check}
            keyOf={(one) => one.method}
            columns={[
              { title: t("optimise.method"), cell: (one) => words(one.method) },
              { title: t("jobs.status"), cell: (one) => t(`jobs.outcome.${one.status}`, one.status) },
              { title: t("jobs.objective"), numeric: true, cell: (one) => (one.objective === null ? "–" : formatNumber(one.objective)) },
              { title: t("jobs.gap"), numeric: true, cell: (one) => share(one.gap) },
            ]}
          />
        </section>
      )}
    </>
  );
}
