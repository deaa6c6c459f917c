import { Group, MultiSelect, NativeSelect, Table, Text, Title, UnstyledButton, useComputedColorScheme } from "@mantine/core";
import { useEffect, useMemo, useRef } from "react";
import { useTranslation } from "react-i18next";
import type { Metric } from "@/shared/api/types";
import { Chart } from "@/shared/charts/Chart";
import { axisOf, inks } from "@/shared/charts/inks";
import { Pairs } from "@/shared/plots/Pairs";
import { MetricValue } from "@/shared/ui/MetricValue";
import { formatMetric, formatNumber, named, withUnit, words } from "@/shared/units/format";
import type { FrontPoint, GoalResult } from "../results";
import { placeIn, placesIn, useLook } from "./look";
import classes from "./FrontView.module.css";

interface Props {
  front: FrontPoint[];
  goals: GoalResult[];
  variables: string[];
  knee: number | null;
  units: Map<string, string>;
  /** The number of the point that is looked at. */
  selected: number | null;
  onSelect(point: number): void;
}

/** What can be had of several objectives at once: a picture of two, all of them side by side, and the table; one choice in all three. */
export function FrontView({ front, goals, variables, knee, units, selected, onSelect }: Props) {
  const { t } = useTranslation();
  const dark = useComputedColorScheme("light") === "dark";
  const names = useMemo(() => goals.map((goal, i) => `${t(`metrics.${goal.metric}`, words(goal.metric))}${goals.some((other, k) => k !== i && other.metric === goal.metric) ? ` ${i + 1}` : ""}`), [goals, t]);
  const varying = useMemo(() => goals.map((_, i) => i).filter((i) => new Set(front.map((point) => point.goals[i]?.value ?? null)).size > 1), [front, goals]);
  const { query, put } = useLook();
  const x = placeIn(query.get("fx"), goals.length) ?? varying[0] ?? 0;
  const y = placeIn(query.get("fy"), goals.length) ?? varying[1] ?? Math.min(1, goals.length - 1);
  const shown = (i: number, value: Metric | undefined): number => (value?.value == null ? NaN : spoken(goals[i]!.metric, value));
  const unitOf = (i: number): string => {
    const value = front.find((point) => point.goals[i]?.value != null)?.goals[i];
    return value?.value == null ? "" : UNITS[goals[i]!.metric] ?? formatMetric(goals[i]!.metric, 1, value.unit).unit;
  };
  const label = (i: number) => (unitOf(i) ? `${names[i]} [${unitOf(i)}]` : names[i]!);
  const scatter = useMemo(() => {
    const { accent, mark, ink, paper } = inks(dark);
    return {
      grid: { left: 66, right: 18, top: 14, bottom: 46 },
      tooltip: { renderMode: "richText", backgroundColor: paper, textStyle: { color: ink }, formatter: (hit: { dataIndex: number }) => t("jobs.point", { number: hit.dataIndex + 1 }) },
      xAxis: axisOf(label(x), dark),
      yAxis: { ...axisOf(label(y), dark), nameGap: 50 },
      series: [
        {
          type: "scatter",
          name: "front",
          data: front.map((point, k) => ({ value: [shown(x, point.goals[x]), shown(y, point.goals[y])], symbol: k === knee ? "triangle" : "circle", symbolSize: k === selected ? 17 : k === knee ? 13 : 9, itemStyle: { color: k === selected ? mark : accent, borderColor: ink, borderWidth: k === selected ? 2 : 0 } })),
        },
      ],
    };
  }, [front, x, y, selected, knee, dark, names, t]);
  const lines = placesIn(query.get("axes"), goals.length + variables.length);
  const parallel = useMemo(() => {
    const { accent, mark, ink, faint } = inks(dark);
    const all = [...goals.map((_, i) => ({ name: label(i), of: (point: FrontPoint) => shown(i, point.goals[i]) })), ...variables.map((name) => ({ name: named(name, units.get(name) ?? ""), of: (point: FrontPoint) => point.parameters[name] ?? NaN }))];
    const axes = lines.flatMap((i) => all[i] ?? []);
    const line = (point: FrontPoint) => axes.map((axis) => axis.of(point));
    const short = (name: string) => name.replace(/ \[/, "\n[");
    return {
      parallel: { left: 44, right: 60, top: 58, bottom: 16, parallelAxisDefault: { scale: true, nameGap: 16, splitNumber: 4, nameTextStyle: { color: ink, fontSize: 11, lineHeight: 14 }, axisLabel: { color: ink, formatter: (value: number) => formatNumber(value, 3) }, axisLine: { lineStyle: { color: faint } } } },
      parallelAxis: axes.map((axis, dim) => ({ dim, name: short(axis.name) })),
      series: [
        { type: "parallel", name: "front", lineStyle: { color: accent, width: 1.2, opacity: 0.55 }, data: front.map(line) },
        { type: "parallel", name: "selected", lineStyle: { color: mark, width: 3.5, opacity: 1 }, data: selected === null ? [] : [line(front[selected]!)], silent: true },
      ],
    };
  }, [front, goals, variables, units, selected, dark, names, lines.join()]);
  const chosen = useRef<HTMLTableRowElement>(null);
  useEffect(() => {
    // Newer browsers answer with a promise, which React would take for what is to be called at the end.
    chosen.current?.scrollIntoView({ block: "nearest" });
  }, [selected]);
  const pick = (_series: string, index: number) => onSelect(index);
  const axis = (value: number, onChange: (next: number) => void, text: string) => <NativeSelect size="xs" label={text} value={String(value)} data={names.map((name, i) => ({ value: String(i), label: name }))} onChange={(event) => onChange(Number(event.currentTarget.value))} />;
  return (
    <section data-testid="front">
      <Title order={2} mb={4}>
        {t("jobs.front")}
      </Title>
      <Text fz="sm" c="dimmed" mb="xs">
        {t("jobs.frontDoc")}
      </Text>
      <Group gap="sm" mb="xs" align="flex-end">
        {goals.length > 1 && axis(x, (next) => put({ fx: String(next), fy: String(next === y ? x : y) }), t("jobs.across"))}
        {goals.length > 1 && axis(y, (next) => put({ fx: String(next === x ? y : x), fy: String(next) }), t("jobs.upwards"))}
        <MultiSelect label={t("jobs.axes")} data={[...names, ...variables].map((name, i) => ({ value: String(i), label: name }))} value={lines.map(String)} onChange={(next) => put({ axes: next.length === 0 || next.length === goals.length + variables.length ? null : next.toSorted((a, b) => Number(a) - Number(b)).join(",") })} maw={620} />
      </Group>
      <Pairs>
        <Chart option={scatter} height={300} summary={t("jobs.frontSummary", { x: names[x], y: names[y] })} onPick={pick} />
        <Chart option={parallel} height={300} summary={t("jobs.parallelSummary")} onPick={pick} />
      </Pairs>
      <Table.ScrollContainer minWidth={520} mah={360} scrollAreaProps={{ viewportProps: { tabIndex: 0, role: "group", "aria-label": t("jobs.front") } }}>
        <Table stickyHeader>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>#</Table.Th>
              {names.map((name) => (
                <Table.Th key={name} ta="right">
                  {name}
                </Table.Th>
              ))}
              {variables.map((name) => (
                <Table.Th key={name} ta="right">
                  {name}
                </Table.Th>
              ))}
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {front.map((point, k) => (
              <Table.Tr key={k} ref={k === selected ? chosen : undefined} className={classes.row} data-chosen={k === selected}>
                <Table.Td>
                  <UnstyledButton fz="sm" className={classes.choose} aria-pressed={k === selected} aria-label={t("jobs.choosePoint", { number: k + 1 })} onClick={() => onSelect(k)}>
                    {k + 1}
                    {k === knee ? " ▲" : ""}
                  </UnstyledButton>
                </Table.Td>
                {point.goals.map((value, i) => (
                  <Table.Td key={i} ta="right" className="numbers">
                    <MetricValue kind={goals[i]?.metric ?? ""} metric={value} />
                  </Table.Td>
                ))}
                {variables.map((name) => (
                  <Table.Td key={name} ta="right" className="numbers">
                    {withUnit(point.parameters[name] ?? NaN, units.get(name) ?? "")}
                  </Table.Td>
                ))}
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </Table.ScrollContainer>
    </section>
  );
}

/** Axes keep one unit from end to end, without prefixes. */
const UNITS: Record<string, string> = { overshoot: "%", undershoot: "%", phase_margin: "°", gain_margin: "dB", rise_time: "s", response_time: "s", settling_time: "s", bandwidth: "rad/s" };

function spoken(metric: string, { value, unit }: Metric): number {
  if (value === null) return NaN;
  if (metric === "overshoot" || metric === "undershoot") return 100 * value;
  if (metric === "phase_margin") return (value * 180) / Math.PI;
  if (metric === "gain_margin" && unit === "1") return 20 * Math.log10(value);
  return value;
}
