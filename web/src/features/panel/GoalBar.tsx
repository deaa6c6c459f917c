import { Button, CloseButton, Group, NativeSelect, Text, TextInput } from "@mantine/core";
import { useEffect, useState } from "react";
import { useTranslation } from "react-i18next";
import { Link } from "react-router";
import type { Metric } from "@/shared/api/types";
import { formatNumber, words } from "@/shared/units/format";
import { useDraft } from "@/shared/ui/useDraft";
import { readEntry } from "@/shared/units/number";
import { holds, WANTED, type PanelGoal } from "@/shared/responses/goals";
import classes from "./GoalBar.module.css";

interface Props {
  goals: PanelGoal[];
  /** What is measured now: a new goal begins with it. */
  current: Record<string, Metric>;
  /** Metrics that can be had here. */
  metrics: string[];
  /** The optimisation that searches for these goals. */
  search: string;
  onChange(goals: PanelGoal[]): void;
}

/** How each bound is spoken of: per cent, degrees, decibel. */
interface Spoken {
  unit: string;
  show(value: number): number;
  read(shown: number): number;
}
const PLAIN: Spoken = { unit: "", show: (v) => v, read: (v) => v };
const TIME: Spoken = { ...PLAIN, unit: "s" };
const PART: Spoken = { unit: "%", show: (v) => 100 * v, read: (v) => v / 100 };
const SPOKEN: Record<string, Spoken> = {
  overshoot: PART,
  undershoot: PART,
  rise_time: TIME,
  response_time: TIME,
  settling_time: TIME,
  bandwidth: { ...PLAIN, unit: "rad/s" },
  phase_margin: { unit: "°", show: (v) => (v * 180) / Math.PI, read: (v) => (v * Math.PI) / 180 },
  gain_margin: { unit: "dB", show: (v) => 20 * Math.log10(v), read: (v) => 10 ** (v / 20) },
};

/** What is wanted of the moving curve: each goal a bound to be typed, and a zone in a plot to be dragged. */
export function GoalBar({ goals, current, metrics, search, onChange }: Props) {
  const { t } = useTranslation();
  const free = Object.keys(WANTED).filter((name) => metrics.includes(name) && !goals.some((goal) => goal.metric === name));
  const add = (metric: string) => {
    const { bound, first } = WANTED[metric]!;
    const now = current[metric]?.value;
    const value = Number.isFinite(first) ? first : now != null ? Number((now * (bound === "upper" ? 1.1 : 0.9)).toPrecision(3)) : 1;
    onChange([...goals, { metric, bound, value }]);
  };
  return (
    <Group gap="xs" align="center" role="group" aria-label={t("panel.goals")}>
      <NativeSelect size="xs" aria-label={t("panel.addGoal")} value="" data={[{ value: "", label: t("panel.addGoal") }, ...free.map((name) => ({ value: name, label: t(`metrics.${name}`, words(name)) }))]} onChange={(event) => event.currentTarget.value && add(event.currentTarget.value)} w={150} />
      {goals.map((goal) => (
        <GoalChip key={goal.metric} goal={goal} met={holds(goal, current[goal.metric]?.value)} onChange={(value) => onChange(goals.map((one) => (one === goal ? { ...goal, value } : one)))} onDrop={() => onChange(goals.filter((one) => one !== goal))} />
      ))}
      {goals.length > 0 && (
        <Button component={Link} to={search} variant="light">
          {t("panel.optimise")}
        </Button>
      )}
    </Group>
  );
}

function GoalChip({ goal, met, onChange, onDrop }: { goal: PanelGoal; met: boolean | null; onChange(value: number): void; onDrop(): void }) {
  const { t } = useTranslation();
  const { unit, show, read } = SPOKEN[goal.metric] ?? PLAIN;
  const given = formatNumber(show(goal.value)).replace("−", "-");
  const { text, type, take, giveUp } = useDraft(given);
  const [wrong, setWrong] = useState(false);
  useEffect(() => setWrong(false), [given]);
  const name = t(`metrics.${goal.metric}`, words(goal.metric));
  const commit = () => {
    if (!take()) return;
    if (text === given) return setWrong(false);
    const entry = readEntry(text, unit);
    const value = entry.kind === "number" ? entry.value : entry.kind === "quantity" && entry.unit === unit ? entry.value : NaN;
    if (!Number.isFinite(value)) return setWrong(true);
    onChange(read(value));
  };
  return (
    <span className={classes.goal} data-testid="goal" data-met={met ?? undefined}>
      <Text span fz="xs" aria-hidden fw={700}>
        {met === null ? "·" : met ? "✓" : "✗"}
      </Text>
      <Text span fz="xs">
        {name} {goal.bound === "upper" ? "≤" : "≥"}
      </Text>
      <TextInput aria-label={t("panel.boundOf", { metric: name })} title={t(met === null ? "panel.goalOpen" : met ? "panel.goalMet" : "panel.goalMissed")} value={text} error={wrong} onChange={(event) => type(event.currentTarget.value)} onBlur={commit} onKeyDown={(event) => (event.key === "Enter" ? commit() : event.key === "Escape" && giveUp())} size="xs" w={72} classNames={{ input: "numbers" }} spellCheck={false} autoComplete="off" />
      <Text span fz="xs">
        {unit}
      </Text>
      <CloseButton size="xs" aria-label={t("panel.dropGoal", { metric: name })} onClick={onDrop} />
    </span>
  );
}
