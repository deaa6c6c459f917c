import { Button, Group, NativeSelect, Table, Text, Title } from "@mantine/core";
import { Fragment, useState } from "react";
import { useTranslation } from "react-i18next";
import type { MetricEntry, Scalar } from "@/shared/api/types";
import { NumberEntry } from "@/shared/ui/NumberEntry";
import { formatMetric, words } from "@/shared/units/format";
import { goalOf } from "./address";
import { changed, without, type Part } from "./form";
import { GoalMore } from "./GoalMore";
import { Drop, More, RowFaults } from "./parts";
import { goalMetrics } from "./problem";
import { needsOf, type Goal } from "./schema";

const FIELDS = ["metric", "output", "experiment", "from", "loop", "sense", "lower", "upper", "target", "tolerance", "soft", "weight", "upperCurve", "lowerCurve", "curveScale", "reference", "band"] as const;

/** Whether something is said of a goal that its row has no place for. */
const hasMore = ({ metric, target, tolerance, soft, weight }: Goal) => needsOf(metric) !== "" || target !== undefined || tolerance !== undefined || soft || weight !== undefined;

/** What is wanted: of which curve, and on which side of which bound. */
export function Goals(part: Part) {
  const { form, opened, loops, metrics, change, faultAt } = part;
  const { t } = useTranslation();
  const [open, setOpen] = useState<ReadonlySet<number>>(new Set());
  const put = (i: number, own: Partial<Goal>) => change({ goals: changed(form.goals, i, own) });
  const toggle = (i: number) => setOpen((before) => new Set(before.has(i) ? [...before].filter((k) => k !== i) : [...before, i]));
  const outputs = opened.outputs.map(({ name }) => name);
  const first = form.goals.at(-1);
  const add = () => change({ goals: [...form.goals, { ...goalOf({ metric: "overshoot", output: first?.output ?? outputs[0] ?? "", sense: "", upper: 0.05 }, first?.from ?? opened.inputs[0] ?? "", first?.loop ?? loops[0] ?? "") }] });
  return (
    <section data-testid="wanted">
      <Title order={2}>{t("optimise.goals")}</Title>
      <Text fz="sm" c="dimmed" mb="xs">
        {t("optimise.goalsDoc")}
      </Text>
      {form.goals.length > 0 && (
        <Table.ScrollContainer minWidth={860}>
          <Table maw={1180} verticalSpacing={4} style={{ verticalAlign: "top" }}>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>{t("influence.metric")}</Table.Th>
                <Table.Th>{t("optimise.of")}</Table.Th>
                <Table.Th>{t("optimise.sense")}</Table.Th>
                <Table.Th>{t("optimise.least")}</Table.Th>
                <Table.Th>{t("optimise.most")}</Table.Th>
                <Table.Th aria-label={t("systems.actions")} />
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {form.goals.map((row, i) => {
                const entry = metrics.get(row.metric);
                const unit = boundUnit(entry, opened.outputs.find(({ name }) => name === row.output)?.unit);
                const wide = open.has(i) || hasMore(row);
                const bound = (key: "lower" | "upper", label: string) => (
                  <NumberEntry aria-label={t(label, { number: i + 1 })} value={row[key]} unit={unit} error={faultAt(`goals.${i}.${key}`) !== undefined} optional onCommit={(value) => put(i, { [key]: value })} w={120} {...spoken(row.metric, row[key])} />
                );
                return (
                  <Fragment key={i}>
                    <Table.Tr style={{ verticalAlign: "top" }}>
                      <Table.Td>
                        <NativeSelect size="xs" aria-label={t("optimise.goal", { number: i + 1 })} title={entry?.definition} value={row.metric} data={goalMetrics(metrics.values(), loops, row.metric).map((m) => ({ value: m.kind, label: t(`metrics.${m.kind}`, words(m.kind)) }))} onChange={(event) => put(i, { metric: event.currentTarget.value })} />
                        <RowFaults row={`goals.${i}`} fields={FIELDS} faultAt={faultAt} />
                      </Table.Td>
                      <Table.Td>
                        <Where goal={row} number={i + 1} domain={entry?.domain} part={part} onChange={(own) => put(i, own)} />
                      </Table.Td>
                      <Table.Td>
                        <NativeSelect
                          size="xs"
                          aria-label={t("optimise.senseOf", { number: i + 1 })}
                          value={row.sense}
                          data={[
                            { value: "", label: t("optimise.bound") },
                            { value: "minimize", label: t("optimise.minimize") },
                            { value: "maximize", label: t("optimise.maximize") },
                          ]}
                          onChange={(event) => put(i, { sense: event.currentTarget.value as Goal["sense"] })}
                        />
                      </Table.Td>
                      <Table.Td>{bound("lower", "optimise.atLeast")}</Table.Td>
                      <Table.Td>{bound("upper", "optimise.atMost")}</Table.Td>
                      <Table.Td w={76}>
                        <Group gap={0} wrap="nowrap" justify="flex-end">
                          <More label={t("optimise.moreOfGoal", { number: i + 1 })} open={wide} onClick={() => toggle(i)} />
                          <Drop label={t("optimise.drop", { name: words(row.metric) })} onClick={() => change({ goals: without(form.goals, i) })} />
                        </Group>
                      </Table.Td>
                    </Table.Tr>
                    {wide && (
                      <Table.Tr>
                        <Table.Td colSpan={6} pt={0}>
                          <GoalMore goal={row} number={i + 1} unit={unit} outputUnit={opened.outputs.find(({ name }) => name === row.output)?.unit ?? ""} at={`goals.${i}`} faultAt={faultAt} onChange={(own) => put(i, own)} />
                        </Table.Td>
                      </Table.Tr>
                    )}
                  </Fragment>
                );
              })}
            </Table.Tbody>
          </Table>
        </Table.ScrollContainer>
      )}
      {faultAt("goals") && (
        <Text fz="xs" c="var(--mantine-color-error)" role="alert">
          {faultAt("goals")}
        </Text>
      )}
      <Button variant="default" mt="xs" onClick={add}>
        {t("optimise.addGoal")}
      </Button>
    </section>
  );
}

/** Of which response a goal is: an output and its experiment, a path, an opened loop; nothing for one of the whole system. */
function Where({ goal, number, domain, part: { form, opened, loops }, onChange }: { goal: Goal; number: number; domain: string | undefined; part: Part; onChange(own: Partial<Goal>): void }) {
  const { t } = useTranslation();
  const output = <NativeSelect size="xs" aria-label={t("optimise.ofGoal", { number })} value={goal.output} data={opened.outputs.map(({ name }) => name)} onChange={(event) => onChange({ output: event.currentTarget.value })} />;
  if (domain === "loop") return <NativeSelect size="xs" aria-label={t("optimise.loopOfGoal", { number })} value={goal.loop} data={loops} onChange={(event) => onChange({ loop: event.currentTarget.value })} />;
  if (domain === "system") return <Text fz="sm">{t("optimise.wholeSystem")}</Text>;
  if (domain === "path")
    return (
      <Group gap={4} wrap="nowrap">
        <NativeSelect size="xs" aria-label={t("optimise.fromGoal", { number })} value={goal.from} data={opened.inputs} onChange={(event) => onChange({ from: event.currentTarget.value })} />
        <Text fz="sm">→</Text>
        {output}
      </Group>
    );
  return (
    <Group gap={4} wrap="nowrap">
      {output}
      {form.experiments.length > 1 && <NativeSelect size="xs" aria-label={t("optimise.experimentOfGoal", { number })} value={goal.experiment} data={[{ value: "", label: t("optimise.everyExperiment") }, ...form.experiments.map(({ name }) => name)]} onChange={(event) => onChange({ experiment: event.currentTarget.value })} />}
    </Group>
  );
}

/** The unit of a metric's bounds: its own, or that of the output where it takes it from there. */
export function boundUnit(entry: Pick<MetricEntry, "unit"> | undefined, output = ""): string {
  const unit = entry?.unit ?? "";
  if (unit === "output") return output === "1" ? "" : output;
  if (unit.includes("input") || unit === "1") return "";
  return unit.replace("output", /[*/]/.test(output) ? `(${output})` : output === "" ? "1" : output).replace(/^1(\*\*2)?\*/, "");
}

/** A bound in the words of its field, where these are others: 0.05 is 5 %, 0.785 rad is 45°. */
function spoken(metric: string, value: Scalar | undefined): { description?: string; inputWrapperOrder?: ("input" | "description" | "error")[] } {
  if (typeof value !== "number") return {};
  const shown = formatMetric(metric, value, "1");
  return ["%", "°", "dB"].includes(shown.unit) ? { description: `= ${shown.text} ${shown.unit}`, inputWrapperOrder: ["input", "description", "error"] } : {};
}
