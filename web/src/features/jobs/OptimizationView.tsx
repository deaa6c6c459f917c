import { Alert, Badge, Button, Group, SimpleGrid, Slider, Stack, Table, Text, Title, useComputedColorScheme } from "@mantine/core";
import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useMemo, useState } from "react";
import { useTranslation } from "react-i18next";
import { Link, useNavigate } from "react-router";
import { saveSystem, systemQuery } from "@/shared/api/systems";
import type { Metric } from "@/shared/api/types";
import { stroke } from "@/shared/plots/palette";
import { Plot } from "@/shared/plots/Plot";
import type { PlotSpec } from "@/shared/plots/types";
import { withValues } from "@/shared/systems/apply";
import { describedQuery } from "@/shared/systems/described";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { formatMetric, formatNumber, withUnit, words } from "@/shared/units/format";
import { Convergence } from "./JobPage";
import { numbersOf, panelAt, type Curves, type OptimizationResult } from "./results";

/** What came out: the values, every goal before and after, the curves, the certificate; and what to do with it. */
export function OptimizationView({ result }: { result: OptimizationResult }) {
  const { t } = useTranslation();
  const navigate = useNavigate();
  const queries = useQueryClient();
  const found = result.system;
  const system = useQuery({ ...systemQuery(found?.id ?? ""), enabled: found !== null });
  const described = useQuery({ ...describedQuery(found?.id ?? "", system.data?.revision ?? 0), enabled: system.isSuccess });
  const steps = result.history.filter((step) => step.variables);
  const [step, setStep] = useState<number | null>(null);
  const values = (step === null ? undefined : steps[step]?.variables) ?? result.best;
  const infos = new Map((described.data?.parameters ?? []).map((p) => [p.path, p]));
  const save = useMutation({
    mutationFn: () => saveSystem(found!.id, withValues(system.data!.document, Object.fromEntries(Object.entries(values).filter(([path]) => infos.has(path)).map(([path, value]) => [path, { value, unit: infos.get(path)!.unit }]))), system.data!.etag),
    onSuccess: async () => {
      await queries.invalidateQueries({ queryKey: ["system", found!.id] });
      void navigate(`/systems/${found!.id}/revisions`);
    },
  });
  const good = result.status === "converged";
  const shown = (metric: string, m: Metric) => {
    if (m.value === null) return t(`verdicts.${m.verdict}`, m.verdict);
    const text = formatMetric(metric, m.value, m.unit);
    return `${text.text} ${text.unit}`;
  };
  return (
    <Stack gap="lg" data-testid="optimum">
      <Alert color={good ? "green" : "orange"} variant="outline" title={t(`jobs.outcome.${result.status}`, result.status)}>
        {result.advice}
      </Alert>
      <section>
        <Title order={2} mb="xs">
          {t("jobs.values")}
        </Title>
        <Group gap="xs" mb="sm">
          {Object.entries(values).map(([path, value]) => (
            <Badge key={path} variant="outline" color="gray" size="lg" tt="none" fw={500} c="var(--ink)">
              {path} = {withUnit(value, infos.get(path)?.unit ?? "", 5)}
            </Badge>
          ))}
        </Group>
        {found && (
          <Group gap="xs">
            <Button component={Link} to={panelAt(found.id, values)}>
              {t("jobs.toPanel")}
            </Button>
            <Button variant="default" onClick={() => save.mutate()} disabled={!system.data || !described.data} loading={save.isPending}>
              {t("panel.save")}
            </Button>
          </Group>
        )}
        <ProblemAlert error={save.error} />
      </section>
      <section>
        <Title order={2} mb="xs">
          {t("jobs.goals")}
        </Title>
        <Table.ScrollContainer minWidth={520}>
          <Table maw={900} data-testid="goals">
            <Table.Thead>
              <Table.Tr>
                <Table.Th>{t("influence.metric")}</Table.Th>
                <Table.Th>{t("optimise.of")}</Table.Th>
                <Table.Th ta="right">{t("revisions.before")}</Table.Th>
                <Table.Th ta="right">{t("revisions.after")}</Table.Th>
                <Table.Th>{t("jobs.met")}</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {result.goals.map((goal, i) => (
                <Table.Tr key={i}>
                  <Table.Td>{t(`metrics.${goal.metric}`, words(goal.metric))}</Table.Td>
                  <Table.Td>{goal.output ?? ""}</Table.Td>
                  <Table.Td ta="right" className="numbers">
                    {shown(goal.metric, goal.before)}
                  </Table.Td>
                  <Table.Td ta="right" className="numbers" fw={600}>
                    {shown(goal.metric, goal.after)}
                  </Table.Td>
                  <Table.Td>
                    {goal.met ? "✓" : "✗"} {goal.active && t("jobs.active")}
                  </Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        </Table.ScrollContainer>
        <Text fz="sm" mt="xs">
          {result.certificate.valid ? t("jobs.certified") : t("jobs.notCertified", { violation: formatNumber(result.certificate.worst_violation ?? Infinity, 3) })} {t("jobs.effort", { evaluations: result.evaluations, seconds: formatNumber(result.seconds, 3) })}
        </Text>
      </section>
      <BeforeAfter before={result.curves.before} after={result.curves.after} />
      {steps.length > 1 && (
        <section>
          <Title order={2} mb="xs">
            {t("jobs.course")}
          </Title>
          <Convergence points={result.history.flatMap((h) => (h.objective === null ? [] : [{ evaluation: h.evaluation, objective: h.objective, violation: h.violation ?? 0 }]))} />
          <Text fz="xs" mt="xs">
            {step === null ? t("jobs.scrub") : t("jobs.atStep", { evaluation: steps[step]!.evaluation, objective: formatNumber(steps[step]!.objective ?? NaN, 4) })}
          </Text>
          <Slider min={0} max={steps.length - 1} value={step ?? steps.length - 1} onChange={(next) => setStep(next === steps.length - 1 ? null : next)} thumbLabel={t("jobs.scrub")} maw={600} label={(v) => steps[v]?.evaluation} />
        </section>
      )}
      {result.front && result.front.length > 0 && (
        <section>
          <Title order={2} mb="xs">
            {t("jobs.front")}
          </Title>
          <Table.ScrollContainer minWidth={520} mah={420}>
            <Table>
              <Table.Thead>
                <Table.Tr>
                  {result.goals.map((goal, i) => (
                    <Table.Th key={i} ta="right">
                      {words(goal.metric)}
                    </Table.Th>
                  ))}
                  {Object.keys(result.best).map((name) => (
                    <Table.Th key={name} ta="right">
                      {name}
                    </Table.Th>
                  ))}
                  <Table.Th aria-label={t("systems.actions")} />
                </Table.Tr>
              </Table.Thead>
              <Table.Tbody>
                {result.front.map((point, k) => (
                  <Table.Tr key={k}>
                    {point.goals.map((value, i) => {
                      const text = value === null ? null : formatMetric(result.goals[i]?.metric ?? "", value, result.goals[i]?.after.unit ?? "");
                      return (
                        <Table.Td key={i} ta="right" className="numbers">
                          {text ? `${text.text} ${text.unit}` : "–"}
                        </Table.Td>
                      );
                    })}
                    {Object.keys(result.best).map((name) => (
                      <Table.Td key={name} ta="right" className="numbers">
                        {formatNumber(point.parameters[name] ?? NaN)}
                      </Table.Td>
                    ))}
                    <Table.Td>{found && <Link to={panelAt(found.id, point.parameters)}>{t("jobs.toPanel")}</Link>}</Table.Td>
                  </Table.Tr>
                ))}
              </Table.Tbody>
            </Table>
          </Table.ScrollContainer>
        </section>
      )}
    </Stack>
  );
}

function BeforeAfter({ before, after }: { before: Record<string, Curves>; after: Record<string, Curves> }) {
  const { t } = useTranslation();
  const dark = useComputedColorScheme("light") === "dark";
  const plots = useMemo(
    () =>
      Object.entries(after).flatMap(([experiment, curves]) =>
        Object.keys(curves.outputs).map((output) => {
          const spec: PlotSpec = { title: `${words(output)} (${experiment})`, x: { label: t("panel.time"), unit: "s" }, y: { label: words(output), unit: "" }, series: [{ label: t("revisions.before"), ...stroke(1, dark) }, { label: t("revisions.after"), ...stroke(0, dark), width: 2.4 }], dark };
          const old = before[experiment];
          const x = numbersOf(curves.time);
          const y = numbersOf(curves.outputs[output]!);
          // Both on the times of the second: uPlot's series share theirs.
          return { spec, curves: [{ x, y: old?.outputs[output] ? resampled(numbersOf(old.time), numbersOf(old.outputs[output]), x) : new Float64Array(x.length).fill(NaN) }, { x, y }] };
        }),
      ),
    [before, after, dark, t],
  );
  return (
    <SimpleGrid cols={{ base: 1, md: 2 }}>
      {plots.map(({ spec, curves }) => (
        <Plot key={spec.title} spec={spec} curves={curves} height={220} summary={spec.title} />
      ))}
    </SimpleGrid>
  );
}

/** A curve at other times, straight between its points; after its end its last value, where it has come to rest. */
export function resampled(time: Float64Array, values: Float64Array, at: Float64Array): Float64Array {
  const found = new Float64Array(at.length);
  let k = 0;
  for (let i = 0; i < at.length; i++) {
    const t = at[i]!;
    while (k + 1 < time.length && time[k + 1]! < t) k++;
    const next = Math.min(k + 1, time.length - 1);
    const span = time[next]! - time[k]!;
    const part = span > 0 ? Math.min(1, Math.max(0, (t - time[k]!) / span)) : 0;
    found[i] = values[k]! + part * (values[next]! - values[k]!);
  }
  return found;
}
