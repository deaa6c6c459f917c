import { Group, NativeSelect, Text } from "@mantine/core";
import { useTranslation } from "react-i18next";
import type { MetricEntry, Scalar } from "@/shared/api/types";
import { toldElsewhere } from "@/shared/forms/faults";
import { NumberEntry } from "@/shared/ui/NumberEntry";
import { formatMetric, words } from "@/shared/units/format";
import { goalOf } from "./address";
import type { Bounded } from "./first";
import { changed, without, type Part } from "./form";
import { GoalMore } from "./GoalMore";
import { goalMetrics } from "./problem";
import { RowTable } from "./RowTable";
import { needsOf, type Goal } from "./schema";

const FIELDS = ["metric", "output", "experiment", "from", "loop", "sense", "lower", "upper", "target", "tolerance", "soft", "weight", "settled", "upperCurve", "lowerCurve", "curveScale", "reference", "band", "number"] as const;

/** Whether something is said of a goal that its row has no place for. */
const hasMore = ({ metric, target, tolerance, soft, weight, settled = false }: Goal) => needsOf(metric) !== "" || target !== undefined || tolerance !== undefined || soft || weight !== undefined || settled;

/** Goals: of which curve, and on which side of which bound. */
export function Goals({ effort, ...part }: Part & { effort: Bounded | null }) {
  const { form, opened, loops, metrics, change, faultAt } = part;
  const { t } = useTranslation();
  const put = (i: number, own: Partial<Goal>) => change({ goals: changed(form.goals, i, own) });
  const wrong = (i: number, field: (typeof FIELDS)[number]) => toldElsewhere(faultAt(`goals.${i}.${field}`));
  const outputs = opened.outputs.map(({ name }) => name);
  const outputUnit = (row: Goal) => opened.outputs.find(({ name }) => name === row.output)?.unit;
  const unitOf = (row: Goal) => boundUnit(metrics.get(row.metric), outputUnit(row));
  const last = form.goals.at(-1);
  const add = () => change({ goals: [...form.goals, { ...goalOf({ metric: "overshoot", output: last?.output ?? outputs[0] ?? "", sense: "", upper: 0.05 }, last?.from ?? opened.inputs[0] ?? "", last?.loop ?? loops[0] ?? "") }] });
  const bound = (row: Goal, i: number, key: "lower" | "upper", label: string) => <NumberEntry aria-label={t(label, { number: i + 1 })} value={row[key]} unit={unitOf(row)} {...wrong(i, key)} optional onCommit={(value) => put(i, { [key]: value })} w={104} {...spoken(row.metric, row[key])} />;
  const proposed = effort && form.goals.some((row) => row.metric === effort.metric && row.upper === effort.upper) ? ` ${effort.limit ? t("optimise.effortLimited", { output: words(effort.output), by: effort.limit.by }) : t("optimise.effortOpen", { output: words(effort.output) })}` : "";
  return (
    <RowTable
      testId="wanted"
      title={t("optimise.goals")}
      doc={t("optimise.goalsDoc") + proposed}
      field="goals"
      fields={FIELDS}
      faultAt={faultAt}
      minWidth={700}
      maxWidth={1180}
      heads={[{ title: t("influence.metric") }, { title: t("optimise.of") }, { title: t("optimise.sense") }, { title: t("optimise.least"), width: 116 }, { title: t("optimise.most"), width: 116 }]}
      rows={form.goals}
      cells={(row, i) => [
        <NativeSelect size="xs" aria-label={t("optimise.goal", { number: i + 1 })} title={metrics.get(row.metric)?.definition} value={row.metric} data={goalMetrics(metrics.values(), loops, row.metric).map((m) => ({ value: m.kind, label: t(`metrics.${m.kind}`, words(m.kind)) }))} {...wrong(i, "metric")} onChange={(event) => put(i, { metric: event.currentTarget.value })} />,
        <Where goal={row} number={i + 1} domain={metrics.get(row.metric)?.domain} part={part} wrong={(field) => wrong(i, field)} onChange={(own) => put(i, own)} />,
        <NativeSelect
          size="xs"
          aria-label={t("optimise.senseOf", { number: i + 1 })}
          value={row.sense}
          data={[
            { value: "", label: t("optimise.bound") },
            { value: "minimize", label: t("optimise.minimize") },
            { value: "maximize", label: t("optimise.maximize") },
          ]}
          {...wrong(i, "sense")}
          onChange={(event) => put(i, { sense: event.currentTarget.value as Goal["sense"] })}
        />,
        bound(row, i, "lower", "optimise.atLeast"),
        bound(row, i, "upper", "optimise.atMost"),
      ]}
      more={(row, i) => ({ label: t("optimise.moreOfGoal", { number: i + 1 }), said: hasMore(row), content: <GoalMore goal={row} number={i + 1} unit={unitOf(row)} outputUnit={outputUnit(row) ?? ""} inTime={(metrics.get(row.metric)?.domain ?? "time") === "time"} at={`goals.${i}`} faultAt={faultAt} onChange={(own) => put(i, own)} /> })}
      dropLabel={(row) => t("optimise.drop", { name: words(row.metric) })}
      onDrop={(i) => change({ goals: without(form.goals, i) })}
      add={{ label: t("optimise.addGoal"), onClick: add }}
    />
  );
}

/** Of which response a goal is: an output and its experiment, a path, an opened loop; nothing for one of the whole system. */
function Where({ goal, number, domain, part: { form, opened, loops }, wrong, onChange }: { goal: Goal; number: number; domain: string | undefined; part: Part; wrong(field: "output" | "experiment" | "from" | "loop"): ReturnType<typeof toldElsewhere>; onChange(own: Partial<Goal>): void }) {
  const { t } = useTranslation();
  const output = <NativeSelect size="xs" aria-label={t("optimise.ofGoal", { number })} value={goal.output} data={opened.outputs.map(({ name }) => name)} {...wrong("output")} onChange={(event) => onChange({ output: event.currentTarget.value })} />;
  if (domain === "loop") return <NativeSelect size="xs" aria-label={t("optimise.loopOfGoal", { number })} value={goal.loop} data={loops} {...wrong("loop")} onChange={(event) => onChange({ loop: event.currentTarget.value })} />;
  if (domain === "system") return <Text fz="sm">{t("optimise.wholeSystem")}</Text>;
  if (domain === "path")
    return (
      <Group gap={4} wrap="nowrap">
        <NativeSelect size="xs" aria-label={t("optimise.fromGoal", { number })} value={goal.from} data={opened.inputs} {...wrong("from")} onChange={(event) => onChange({ from: event.currentTarget.value })} />
        <Text fz="sm">→</Text>
        {output}
      </Group>
    );
  return (
    <Group gap={4} wrap="nowrap">
      {output}
      {form.experiments.length > 1 && <NativeSelect size="xs" aria-label={t("optimise.experimentOfGoal", { number })} value={goal.experiment} data={[{ value: "", label: t("optimise.everyExperiment") }, ...form.experiments.map(({ name }) => name)]} {...wrong("experiment")} onChange={(event) => onChange({ experiment: event.currentTarget.value })} />}
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
