import { Group, List, Text, Title } from "@mantine/core";
import type { ReactNode } from "react";
import { useTranslation } from "react-i18next";
import { DataTable, type Column } from "@/shared/ui/DataTable";
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
      <Compared title={t("jobs.structures")} testId="structures" head={t("jobs.structure")} rows={alternatives} nameOf={({ name }) => (name === chosen ? <b>{name} ★</b> : name)} last={{ title: t("jobs.allMet"), cell: (one) => (one.certificate.valid ? "✓" : "✗") }} />
      <Compared title={t("jobs.checked")} testId="checked" head={t("optimise.method")} rows={cross_check} nameOf={({ method }) => words(method)} last={{ title: t("jobs.gap"), numeric: true, cell: ({ gap }) => share(gap) }} />
    </>
  );
}

interface ComparedProps<Row> {
  title: string;
  testId: string;
  head: string;
  rows: readonly Row[];
  nameOf(row: Row): ReactNode;
  last: Column<Row>;
}

/** Ways that were compared, structures or methods: how each ended, how good it got, and what it is judged by. */
function Compared<Row extends { status: string; objective: number | null }>({ title, testId, head, rows, nameOf, last }: ComparedProps<Row>) {
  const { t } = useTranslation();
  if (rows.length === 0) return null;
  return (
    <section>
      <Title order={2} mb="xs">
        {title}
      </Title>
      <DataTable
        testId={testId}
        maxWidth={760}
        rows={rows}
        keyOf={(_, i) => String(i)}
        columns={[
          { title: head, cell: nameOf },
          { title: t("jobs.status"), cell: ({ status }) => t(`jobs.outcome.${status}`, status) },
          { title: t("jobs.objective"), numeric: true, cell: ({ objective }) => (objective === null ? "–" : formatNumber(objective)) },
          last,
        ]}
      />
    </section>
  );
}
