import { Alert, Badge, Button, Group, List, Stack, Table, Text, Title } from "@mantine/core";
import { useMemo } from "react";
import { useTranslation } from "react-i18next";
import { Link } from "react-router";
import type { components } from "@/shared/api/schema";
import { AnalysisChart } from "@/shared/charts/AnalysisChart";
import type { AnalysisSpec } from "@/shared/charts/analysis";
import { Pairs } from "@/shared/plots/Pairs";
import { formatNumber, prettyUnit, words } from "@/shared/units/format";
import { FitTable } from "./FitTable";
import { numbersOf, panelAt, type FitRow, type Fits } from "./results";

type Schemas = components["schemas"];
type Reply = Schemas["ValidationReply"];
type Output = Schemas["ValidatedOutput"];

/** Whether a model says what the machine does: the verdict, what is left of it, and what to try where it does not. */
export function ValidationView({ result }: { result: Reply }) {
  const { t } = useTranslation();
  const outputs = Object.entries(result.outputs);
  const rows: FitRow[] = outputs.flatMap(([output, found]) => [
    { part: "simulation", output, numbers: found as unknown as Fits, trivial: false },
    ...Object.entries(found.baselines).map(([part, numbers]) => ({ part, output, numbers: numbers as unknown as Fits, trivial: true })),
    ...(found.one_step_prediction ? [{ part: "one_step", output, numbers: found.one_step_prediction.model as unknown as Fits, trivial: true }] : []),
  ]);
  const passed = result.verdict === "pass";
  return (
    <Stack gap="lg" data-testid="validation">
      <Alert color={passed ? "green" : "red"} variant="outline" title={t(`found.grades.${result.grade}`, { limit: formatNumber(result.limit_percent) })}>
        {result.advice}
        {result.remarks.length > 0 && (
          <List size="sm" mt={4}>
            {result.remarks.map((remark) => (
              <List.Item key={remark}>{remark}</List.Item>
            ))}
          </List>
        )}
      </Alert>
      {result.diagnosis && <Diagnosis diagnosis={result.diagnosis} system={result.system} limit={result.limit_percent} />}
      <section>
        <Title order={2} mb="xs">
          {t("found.agreement")}
        </Title>
        <FitTable rows={rows} />
        <List size="xs" mt="xs" c="dimmed">
          {Object.values(result.definitions).map((definition) => (
            <List.Item key={definition}>{definition}</List.Item>
          ))}
        </List>
      </section>
      {outputs.map(([name, output]) => (
        <OutputCharts key={name} name={name} output={output} />
      ))}
      {result.adjustment && <Adjustment rows={result.adjustment.parameters} />}
    </Stack>
  );
}

function OutputCharts({ name, output }: { name: string; output: Output }) {
  const { t } = useTranslation();
  const unit = prettyUnit(output.unit);
  const title = words(name);
  const curves = useMemo<AnalysisSpec>(() => {
    const x = numbersOf(output.curves.time);
    const [from, to] = output.worst_interval;
    return {
      title,
      x: { label: t("panel.time"), unit: "s" },
      y: { label: title, unit },
      lines: [
        { label: t("found.measured"), x, y: numbersOf(output.curves.measured), color: 4 },
        { label: t("found.simulated"), x, y: numbersOf(output.curves.simulated), color: 1 },
      ],
      zones: from != null && to != null ? [{ from, to, label: t("found.worst") }] : [],
    };
  }, [output, title, unit, t]);
  const residual = useMemo<AnalysisSpec>(() => {
    const measured = numbersOf(output.curves.measured);
    return { title: t("found.residualOf", { output: title }), x: { label: t("panel.time"), unit: "s" }, y: { label: t("found.residual"), unit }, lines: [{ label: t("found.residual"), x: numbersOf(output.curves.time), y: numbersOf(output.curves.simulated).map((value, i) => measured[i]! - value), color: 3 }], marks: [{ y: 0, label: "" }] };
  }, [output, title, unit, t]);
  const own = useMemo<AnalysisSpec>(() => {
    const { autocorrelation, autocorrelation_bound: bound, lags } = output.residuals;
    const y = numbersOf(autocorrelation);
    const x = numbersOf(lags).subarray(-y.length);
    return { title: t("found.autocorrelationOf", { output: title }), x: { label: t("found.lag"), unit: "s" }, y: { label: t("found.correlation"), unit: "" }, lines: [{ label: title, x: x.subarray(1), y: y.subarray(1), kind: "bars" }], marks: bound === null ? [] : [{ y: bound, label: "99 %" }, { y: -bound, label: "" }] };
  }, [output, title, t]);
  const cross = useMemo<AnalysisSpec>(() => {
    const { cross_correlation, cross_correlation_bound, lags } = output.residuals;
    const bound = Math.max(...cross_correlation_bound.map((value) => value ?? 0));
    return { title: t("found.crossOf", { output: title }), x: { label: t("found.lag"), unit: "s" }, y: { label: t("found.correlation"), unit: "" }, lines: cross_correlation.map((values, i) => ({ label: t("found.input", { number: i + 1 }), x: numbersOf(lags), y: numbersOf(values) })), marks: bound > 0 ? [{ y: bound, label: "99 %" }, { y: -bound, label: "" }] : [] };
  }, [output, title, t]);
  const frequency = output.frequency_domain;
  return (
    <section aria-label={title}>
      <Title order={2} mb="xs">
        {title}
      </Title>
      <Pairs>
        <AnalysisChart spec={curves} summary={t("found.curvesSummary", { output: title, fit: output.fit_percent == null ? "–" : formatNumber(output.fit_percent) })} />
        <AnalysisChart spec={residual} summary={t("found.residualOf", { output: title })} />
        <div>
          <AnalysisChart spec={own} height={200} summary={t("found.autocorrelationOf", { output: title })} />
          <Text fz="sm" mt={4} data-testid="white">
            {t(output.residuals.white ? "found.white" : "found.notWhite")}
          </Text>
        </div>
        <div>
          <AnalysisChart spec={cross} height={200} summary={t("found.crossOf", { output: title })} />
          <Text fz="sm" mt={4}>
            {t(output.residuals.independent ? "found.independent" : "found.notIndependent")}
          </Text>
        </div>
        {frequency && <Frequency found={frequency} title={title} unit={unit} />}
      </Pairs>
    </section>
  );
}

function Frequency({ found, title, unit }: { found: Schemas["FrequencyDomainReply"]; title: string; unit: string }) {
  const { t } = useTranslation();
  const spec = useMemo<AnalysisSpec>(() => {
    const x = numbersOf(found.frequency);
    const band = found.bounds ? { band: { lower: numbersOf(found.bounds.magnitude_lower), upper: numbersOf(found.bounds.magnitude_upper) } } : {};
    return {
      title: t("found.frequencyOf", { output: title }),
      x: { label: "ω", unit: "rad/s", log: true },
      y: { label: t("panel.magnitudeShort"), unit: t("found.perUnit", { unit: unit || "1", input: words(found.input) }), log: true },
      lines: [
        { label: t("found.measured"), x, y: numbersOf(found.measured.magnitude), ...band, color: 4 },
        { label: t("found.simulated"), x, y: numbersOf(found.simulated.magnitude), color: 1 },
      ],
    };
  }, [found, title, unit, t]);
  return (
    <div>
      <AnalysisChart spec={spec} height={200} summary={t("found.frequencyOf", { output: title })} />
      {found.within_percent != null && (
        <Text fz="sm" mt={4}>
          {t("found.within", { percent: formatNumber(found.within_percent, 3), lines: found.lines })}
        </Text>
      )}
    </div>
  );
}

const percent = (value: number | null | undefined) => (value == null ? "–" : `${formatNumber(value, 3)} %`);

/** What would make the error smaller, the most telling first; nothing of it has been fitted. */
function Diagnosis({ diagnosis, system, limit }: { diagnosis: Schemas["DiagnosisReply"]; system: Reply["system"]; limit: number }) {
  const { t } = useTranslation();
  const steps = diagnosis.parameters.filter((step) => step.suggested !== null);
  const together = diagnosis.together;
  const values = Object.fromEntries(Object.entries(together?.suggested ?? {}).flatMap(([name, value]) => (typeof value === "number" ? [[name, value]] : [])));
  return (
    <section data-testid="diagnosis">
      <Title order={2} mb="xs">
        {t("found.tryThis")}
      </Title>
      {Object.entries(diagnosis.remedies).map(([output, remedies]) => (
        <div key={output}>
          <List size="sm" aria-label={words(output)}>
            {remedies.map((remedy) => (
              <List.Item key={remedy.kind}>
                <Badge variant="outline" tt="none" color={remedy.relative_error_percent !== null && remedy.relative_error_percent <= limit ? "green" : "gray"} mr={6}>
                  {t(`found.kinds.${remedy.kind}`)} → {percent(remedy.relative_error_percent)}
                </Badge>
                {remedy.sentence}
              </List.Item>
            ))}
          </List>
        </div>
      ))}
      {steps.length > 0 && (
        <Table.ScrollContainer minWidth={560}>
          <Table maw={860} mt="sm">
            <Table.Thead>
              <Table.Tr>
                <Table.Th>{t("panel.parameters")}</Table.Th>
                <Table.Th ta="right">{t("found.now")}</Table.Th>
                <Table.Th ta="right">{t("found.suggested")}</Table.Th>
                <Table.Th ta="right">{t("found.change")}</Table.Th>
                <Table.Th ta="right">{t("found.promised")}</Table.Th>
                <Table.Th ta="right">{t("found.checked")}</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {steps.map((step) => (
                <Table.Tr key={step.parameter}>
                  <Table.Td>
                    {step.parameter} {prettyUnit(step.unit) && `[${prettyUnit(step.unit)}]`}
                  </Table.Td>
                  <Table.Td ta="right" className="numbers">
                    {step.value === null ? "–" : formatNumber(step.value)}
                  </Table.Td>
                  <Table.Td ta="right" className="numbers" fw={600}>
                    {formatNumber(step.suggested!)}
                  </Table.Td>
                  <Table.Td ta="right" className="numbers">
                    {percent(step.change_percent)}
                  </Table.Td>
                  <Table.Td ta="right" className="numbers">
                    {percent(step.relative_error_percent)}
                  </Table.Td>
                  <Table.Td ta="right" className="numbers">
                    {percent(step.checked_percent)}
                  </Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        </Table.ScrollContainer>
      )}
      <Text fz="xs" c="dimmed" mt="xs">
        {diagnosis.note}
      </Text>
      {system && Object.keys(values).length > 0 && (
        <Group mt="xs">
          <Button variant="default" component={Link} to={panelAt(system.id, values)}>
            {t("found.togetherOnPanel", { error: percent(together?.checked_percent ?? together?.relative_error_percent) })}
          </Button>
        </Group>
      )}
    </section>
  );
}

/** The document's own values, those that were adjusted, and whether theory and measurement agree. */
function Adjustment({ rows }: { rows: Schemas["AdjustedParameter"][] }) {
  const { t } = useTranslation();
  return (
    <section>
      <Title order={2} mb="xs">
        {t("found.adjustment")}
      </Title>
      <Table.ScrollContainer minWidth={620}>
        <Table maw={860}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>{t("panel.parameters")}</Table.Th>
              <Table.Th ta="right">{t("found.theory")}</Table.Th>
              <Table.Th ta="right">{t("found.adjusted")}</Table.Th>
              <Table.Th ta="right">{t("found.change")}</Table.Th>
              <Table.Th ta="right">{t("found.interval")}</Table.Th>
              <Table.Th>{t("found.theoryWithin")}</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {rows.map((row) => (
              <Table.Tr key={row.parameter}>
                <Table.Td>
                  {row.parameter} {prettyUnit(row.unit) && `[${prettyUnit(row.unit)}]`}
                </Table.Td>
                <Table.Td ta="right" className="numbers">
                  {row.theoretical === null ? "–" : formatNumber(row.theoretical)}
                </Table.Td>
                <Table.Td ta="right" className="numbers" fw={600}>
                  {row.adjusted === null ? "–" : formatNumber(row.adjusted)}
                </Table.Td>
                <Table.Td ta="right" className="numbers">
                  {percent(row.change_percent)}
                </Table.Td>
                <Table.Td ta="right" className="numbers">
                  {row.lower95 === null || row.upper95 === null ? "–" : `${formatNumber(row.lower95)} … ${formatNumber(row.upper95)}`}
                </Table.Td>
                <Table.Td>{row.theory_within === null ? "–" : t(row.theory_within ? "found.yes" : "found.no")}</Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </Table.ScrollContainer>
    </section>
  );
}
