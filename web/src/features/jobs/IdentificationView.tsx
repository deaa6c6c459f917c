import { Alert, Button, Group, List, Stack, Table, Text, Title } from "@mantine/core";
import { useMutation, useQueryClient } from "@tanstack/react-query";
import { useMemo } from "react";
import { useTranslation } from "react-i18next";
import { Link } from "react-router";
import { createSystem, saveSystem, systemQuery, systemsKey } from "@/shared/api/systems";
import type { SystemDocument } from "@/shared/api/types";
import { AnalysisChart } from "@/shared/charts/AnalysisChart";
import type { AnalysisSpec } from "@/shared/charts/analysis";
import { Pairs } from "@/shared/plots/Pairs";
import { withValues } from "@/shared/systems/apply";
import { compareAt } from "@/shared/systems/compared";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { formatNumber, prettyUnit, words } from "@/shared/units/format";
import { FitTable } from "./FitTable";
import { fitRows, numbersOf, panelAt, responseRows, type IdentificationResult } from "./results";

/** Identified values with their confidence, what the recording cannot tell apart, and how well the model then follows it. */
export function IdentificationView({ id, result }: { id: string; result: IdentificationResult }) {
  const { t } = useTranslation();
  const values = Object.fromEntries(Object.entries(result.parameters).map(([name, { value }]) => [name, value]));
  const sought = Object.keys(result.parameters);
  const rows = [...fitRows(result.fit, result.one_step_prediction), ...responseRows(result.frequency_responses)];
  return (
    <Stack gap="lg">
      <Alert color={result.status === "converged" ? "green" : "orange"} variant="outline" title={t(`jobs.outcome.${result.status}`, result.status)}>
        {result.advice}
      </Alert>
      {result.expected && (
        <Text fz="xs" c="dimmed" data-testid="effort">
          {t("found.effort", { expected: result.expected.evaluations, of: formatNumber(result.expected.seconds, 2), evaluations: result.evaluations, seconds: formatNumber(result.seconds ?? 0, 2) })}
        </Text>
      )}
      <Actions id={id} result={result} values={values} />
      {sought.length > 0 && (
        <section>
          <Title order={2} mb="xs">
            {t("jobs.values")}
          </Title>
          <Table.ScrollContainer minWidth={620}>
            <Table maw={860} data-testid="identified">
              <Table.Thead>
                <Table.Tr>
                  <Table.Th>{t("panel.parameters")}</Table.Th>
                  <Table.Th ta="right">{t("jobs.value")}</Table.Th>
                  <Table.Th ta="right">{t("found.interval")}</Table.Th>
                  <Table.Th w={160}>{t("found.certainty")}</Table.Th>
                  <Table.Th ta="right">{t("jobs.start")}</Table.Th>
                  <Table.Th>{t("jobs.unit")}</Table.Th>
                </Table.Tr>
              </Table.Thead>
              <Table.Tbody>
                {Object.entries(result.parameters).map(([name, found]) => (
                  <Table.Tr key={name}>
                    <Table.Td>{name}</Table.Td>
                    <Table.Td ta="right" className="numbers" fw={600}>
                      {formatNumber(found.value, 5)}
                    </Table.Td>
                    <Table.Td ta="right" className="numbers">
                      {found.lower95 === null || found.upper95 === null ? t("found.unlimited") : `${formatNumber(found.lower95)} … ${formatNumber(found.upper95)}`}
                    </Table.Td>
                    <Table.Td>
                      <Certainty {...found} />
                    </Table.Td>
                    <Table.Td ta="right" className="numbers">
                      {found.start === null ? "–" : formatNumber(found.start)}
                    </Table.Td>
                    <Table.Td>{prettyUnit(found.unit) || "1"}</Table.Td>
                  </Table.Tr>
                ))}
              </Table.Tbody>
            </Table>
          </Table.ScrollContainer>
          <Text fz="xs" c="dimmed">
            {t("found.intervalDoc")}
          </Text>
          {result.warnings && result.warnings.length > 0 && (
            <Alert color="orange" variant="outline" mt="xs" title={t("found.doubts")} data-testid="doubts">
              <List size="sm">
                {result.warnings.map(({ detail }) => (
                  <List.Item key={detail}>{detail}</List.Item>
                ))}
              </List>
            </Alert>
          )}
          {result.between_samples && (
            <Text fz="sm" mt="xs" data-testid="between">
              {t("found.between", { way: t(`matching.ways.${result.between_samples.chosen}`) })}{" "}
              {Object.entries(result.between_samples.tried)
                .map(([way, { fit_percent }]) => `${t(`matching.ways.${way}`)} ${fit_percent === null ? "–" : `${formatNumber(fit_percent, 5)} %`}`)
                .join(", ")}
            </Text>
          )}
        </section>
      )}
      {result.indistinguishable && sought.length > 1 && (
        <section>
          <Title order={2} mb="xs">
            {t("found.together")}
          </Title>
          {result.indistinguishable.length === 0 ? (
            <Text fz="sm" data-testid="correlation">
              {t("found.apart")}
            </Text>
          ) : (
            <List size="sm" data-testid="correlation">
              {result.indistinguishable.map((sentence) => (
                <List.Item key={sentence}>{sentence}</List.Item>
              ))}
            </List>
          )}
          {result.correlations && <Correlations names={sought} matrix={result.correlations} />}
        </section>
      )}
      {rows.length > 0 && (
        <section>
          <Title order={2} mb="xs">
            {t("jobs.fit")}
          </Title>
          <FitTable rows={rows} />
        </section>
      )}
      {result.tried && result.tried.length > 0 && <Tried tried={result.tried} chosen={result.order ?? result.degree} />}
      {result.residuals && Object.keys(result.residuals).length > 0 && (
        <section>
          <Title order={2} mb="xs">
            {t("found.residuals")}
          </Title>
          <Pairs>
            {Object.entries(result.residuals).map(([output, found]) => (
              <Residual key={output} output={output} values={found.autocorrelation} bound={found.autocorrelation_bound} white={found.white} independent={found.independent} />
            ))}
          </Pairs>
        </section>
      )}
    </Stack>
  );
}

/** The width of an interval beside its value, as a bar: full at 50 % and more. */
function Certainty({ value, lower95, upper95 }: { value: number; lower95: number | null; upper95: number | null }) {
  const { t } = useTranslation();
  if (lower95 === null || upper95 === null || value === 0) return <Text fz="xs">{t("found.nothingLimits")}</Text>;
  const part = (upper95 - lower95) / 2 / Math.abs(value);
  return (
    <Group gap={6} wrap="nowrap">
      <svg width="80" height="8" aria-hidden>
        <rect width="80" height="8" rx="2" fill="var(--grid)" />
        <rect width={Math.min(1, part / 0.5) * 80} height="8" rx="2" fill={part < 0.1 ? "var(--mantine-primary-color-filled)" : "var(--warn)"} />
      </svg>
      <Text span fz="xs" className="numbers" style={{ whiteSpace: "nowrap" }}>
        ±{formatNumber(100 * part, 2)} %
      </Text>
    </Group>
  );
}

function Correlations({ names, matrix }: { names: string[]; matrix: (number | null)[][] }) {
  const { t } = useTranslation();
  return (
    <Table.ScrollContainer minWidth={320}>
      <Table mt="xs" w="auto" withTableBorder aria-label={t("found.correlations")}>
        <Table.Thead>
          <Table.Tr>
            <Table.Td />
            {names.map((name) => (
              <Table.Th key={name} ta="right">
                {name}
              </Table.Th>
            ))}
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {names.map((name, i) => (
            <Table.Tr key={name}>
              <Table.Th>{name}</Table.Th>
              {names.map((other, k) => {
                const value = matrix[i]?.[k];
                return (
                  <Table.Td key={other} ta="right" className="numbers" bg={i !== k && value != null && Math.abs(value) > 0.9 ? "var(--minus)" : undefined}>
                    {value == null ? "–" : formatNumber(value, 2)}
                  </Table.Td>
                );
              })}
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </Table.ScrollContainer>
  );
}

function Tried({ tried, chosen }: { tried: NonNullable<IdentificationResult["tried"]>; chosen: number | undefined }) {
  const { t } = useTranslation();
  const spec = useMemo<AnalysisSpec>(() => {
    const x = tried.map((one) => one.order ?? one.degree ?? NaN);
    const line = (key: "estimation" | "validation") => ({ label: t(`jobs.parts.${key}`), x, y: tried.map((one) => one[key] ?? NaN), kind: "points" as const });
    return { title: t("found.tried"), x: { label: t("found.order"), unit: "" }, y: { label: "FIT", unit: "%" }, lines: [...(tried.some((one) => one.estimation != null) ? [line("estimation")] : []), line("validation")], marks: chosen === undefined ? [] : [{ x: chosen, label: t("found.chosen") }] };
  }, [tried, chosen, t]);
  return <AnalysisChart spec={spec} height={220} summary={t("found.tried")} />;
}

/** What an output's residuals still hold: their correlation with themselves, within the bounds of chance or not. */
function Residual({ output, values, bound, white, independent }: { output: string; values: (number | null)[]; bound: number | null; white: boolean; independent: boolean }) {
  const { t } = useTranslation();
  const spec = useMemo<AnalysisSpec>(() => {
    const y = numbersOf(values).subarray(1);
    return { title: t("found.autocorrelationOf", { output: words(output) }), x: { label: t("found.lag"), unit: t("found.samples") }, y: { label: t("found.correlation"), unit: "" }, lines: [{ label: words(output), x: [...y.keys()].map((k) => k + 1), y, kind: "bars" }], marks: bound === null ? [] : [{ y: bound, label: "99 %" }, { y: -bound, label: "" }] };
  }, [output, values, bound, t]);
  return (
    <div>
      <AnalysisChart spec={spec} height={200} summary={t("found.autocorrelationOf", { output })} />
      <Text fz="sm" mt={4}>
        {t(white ? "found.white" : "found.notWhite")} {t(independent ? "found.independent" : "found.notIndependent")}
      </Text>
    </div>
  );
}

/** What is done with what was found: looked at, kept as a revision or as a system of its own, validated. */
function Actions({ id, result, values }: { id: string; result: IdentificationResult; values: Record<string, number> }) {
  const { t } = useTranslation();
  const queries = useQueryClient();
  const system = result.system?.id;
  const revise = useMutation({
    mutationFn: async () => {
      const { document, etag } = await queries.fetchQuery(systemQuery(system!));
      const changed = withValues(document, Object.fromEntries(Object.entries(result.parameters).map(([name, { value, unit }]) => [name, { value, unit }])));
      return (await saveSystem(system!, changed, etag, id)).data;
    },
    onSuccess: () => queries.invalidateQueries({ queryKey: ["system", system] }),
  });
  const create = useMutation({
    mutationFn: () => createSystem(result.document as SystemDocument),
    onSuccess: () => queries.invalidateQueries({ queryKey: systemsKey }),
  });
  const known = Object.keys(values).length > 0 && system !== undefined;
  return (
    <Stack gap="xs">
      <Group>
        {known && (
          <Button component={Link} to={panelAt(system, values)}>
            {t("jobs.toPanel")}
          </Button>
        )}
        {known && (
          <Button variant="default" onClick={() => revise.mutate()} disabled={revise.isSuccess} loading={revise.isPending}>
            {t("found.revise")}
          </Button>
        )}
        {known && (
          <Button variant="default" component={Link} to={`/validate?${new URLSearchParams({ system, identification: id }).toString()}`}>
            {t("matching.validate")}
          </Button>
        )}
        {result.system && (
          <Button variant="default" component={Link} to={compareAt([{ kind: "revision", ...result.system }, { kind: "job", id }])}>
            {t("compare.withStart", { number: result.system.revision })}
          </Button>
        )}
        {result.document != null && (
          <Button variant="default" onClick={() => create.mutate()} disabled={create.isSuccess} loading={create.isPending}>
            {t("found.keepModel")}
          </Button>
        )}
      </Group>
      <ProblemAlert error={revise.error ?? create.error} />
      {revise.data && (
        <Text fz="sm" role="status">
          {t("found.revised", { number: revise.data.revision })}
        </Text>
      )}
      {create.data && (
        <Text fz="sm" role="status" component={Link} to={`/systems/${create.data}/panel`} c="var(--mantine-color-anchor)">
          {t("found.kept")}
        </Text>
      )}
    </Stack>
  );
}
