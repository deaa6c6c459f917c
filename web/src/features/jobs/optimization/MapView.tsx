import { Button, Group, NativeSelect, Slider, Stack, Text, Title, useComputedColorScheme } from "@mantine/core";
import { useMemo } from "react";
import { useTranslation } from "react-i18next";
import { Chart } from "@/shared/charts/Chart";
import { axisOf, inks, SEQUENTIAL } from "@/shared/charts/inks";
import { formatNumber, named, withUnit } from "@/shared/units/format";
import { useLook } from "./look";
import { flatOf, isMet, nearest, sliceOf, type GridMap } from "./map";

interface Props {
  map: GridMap;
  /** Where the values shown on the page lie. */
  values: Record<string, number>;
  /** The way of the best point through the search. */
  path: Record<string, number>[];
  units: Map<string, string>;
  /** The cell that is looked at: its place on each axis. */
  chosen: number[] | null;
  /** Left out where a cell does not say the values of all variables. */
  onChoose?: (cell: number[] | null) => void;
}

/** The objective over two of the variables, as a map; of further variables a slice. A cell that is chosen is a candidate. */
export function MapView({ map, values, path, units, chosen, onChoose }: Props) {
  const { t } = useTranslation();
  const dark = useComputedColorScheme("light") === "dark";
  const { query, put } = useLook();
  const names = Object.keys(map.axes);
  const known = (key: string) => (names.includes(query.get(key) ?? "") ? query.get(key)! : null);
  const x = known("mx") ?? names.find((name) => name !== known("my"))!;
  const y = known("my") !== null && known("my") !== x ? known("my")! : names.find((name) => name !== x)!;
  const here = names.map((name, i) => chosen?.[i] ?? nearest(map.axes[name]!, values[name] ?? NaN));
  const there = here.join();
  const option = useMemo(() => {
    const at = Object.fromEntries(names.map((name, i) => [name, here[i]!]));
    const cells = sliceOf(map, x, y, at);
    const finite = cells.flatMap((cell) => (cell.objective === null ? [] : [cell.objective]));
    const [low, high] = [Math.min(...finite), Math.max(...finite)];
    // Penalties of unstable corners would leave one colour for all the rest.
    const log = low > 0 && high / low > 20;
    const level = (objective: number) => (log ? Math.log10(objective) : objective);
    const { ink, mark, paper } = inks(dark);
    const category = (name: string) => axisOf(named(name, units.get(name) ?? ""), dark, { type: "category", data: map.axes[name]!.map((v) => formatNumber(v, 3)), scale: undefined, splitLine: { show: false } });
    const place = (point: Record<string, number>) => [nearest(map.axes[x]!, point[x] ?? NaN), nearest(map.axes[y]!, point[y] ?? NaN)];
    const text = (cell: (typeof cells)[number]) => `${x} = ${withUnit(map.axes[x]![cell.x]!, units.get(x) ?? "")}\n${y} = ${withUnit(map.axes[y]![cell.y]!, units.get(y) ?? "")}\n${t("jobs.objective")} ${cell.objective === null ? "–" : formatNumber(cell.objective)}${cell.met ? "" : `\n${t("jobs.missed")}`}`;
    return {
      grid: { left: 76, right: 116, top: 20, bottom: 48 },
      tooltip: { renderMode: "richText", backgroundColor: paper, textStyle: { color: ink }, formatter: (hit: { seriesType: string; dataIndex: number }) => (hit.seriesType === "heatmap" ? text(cells[hit.dataIndex]!) : "") },
      xAxis: category(x),
      yAxis: { ...category(y), nameGap: 58 },
      visualMap: { min: level(low), max: level(high), calculable: false, right: 4, top: "middle", text: [`${t("jobs.objective")} ${formatNumber(high, 3)}`, formatNumber(low, 3)], textStyle: { color: ink }, inRange: { color: SEQUENTIAL }, seriesIndex: 0 },
      series: [
        { type: "heatmap", name: "map", data: cells.map((cell) => ({ value: [cell.x, cell.y, cell.objective === null ? "-" : level(cell.objective)], itemStyle: { opacity: cell.met ? 1 : 0.28 } })) },
        { type: "line", name: "path", data: path.map(place), symbol: "circle", symbolSize: 5, lineStyle: { color: mark, width: 1.5, type: "dashed" }, itemStyle: { color: mark }, silent: true },
        { type: "scatter", name: "best", data: [[at[x], at[y]]], symbol: "diamond", symbolSize: 17, itemStyle: { color: mark, borderColor: dark ? "#000" : "#fff", borderWidth: 2 }, silent: true },
      ],
    };
  }, [map, x, y, there, path, units, dark, t]);
  const pick = (series: string, index: number) => {
    if (series !== "map" || !onChoose) return;
    // Cells of a slice stand column by column, as they are drawn.
    const rows = map.axes[y]!.length;
    onChoose(names.map((name, i) => (name === x ? Math.floor(index / rows) : name === y ? index % rows : here[i]!)));
  };
  const place = flatOf(map, here);
  const objective = map.objective[place] ?? null;
  return (
    <section data-testid="map">
      <Title order={2} mb={4}>
        {t("jobs.map")}
      </Title>
      <Text fz="sm" c="dimmed" mb="xs" maw={860}>
        {t("jobs.mapDoc")}
      </Text>
      <Group align="flex-start" gap="lg">
        <div style={{ flex: "1 1 520px", maxWidth: 760, minWidth: 0 }}>
          <Chart option={option} height={380} summary={t("jobs.mapSummary", { x, y })} onPick={pick} />
        </div>
        <Stack gap="sm" w={260}>
          {names.length > 2 && (
            <Group gap="sm" grow>
              <NativeSelect size="xs" label={t("jobs.across")} value={x} data={names.filter((name) => name !== y)} onChange={(event) => put({ mx: event.currentTarget.value, my: y })} />
              <NativeSelect size="xs" label={t("jobs.upwards")} value={y} data={names.filter((name) => name !== x)} onChange={(event) => put({ mx: x, my: event.currentTarget.value })} />
            </Group>
          )}
          {onChoose &&
            names.map((name, i) => (
              <div key={name}>
                <Text fz="xs" className="numbers">
                  {name} = {withUnit(map.axes[name]![here[i]!]!, units.get(name) ?? "")}
                </Text>
                <Slider size="sm" min={0} max={map.axes[name]!.length - 1} value={here[i]!} onChange={(next) => onChoose(here.map((old, k) => (k === i ? next : old)))} thumbLabel={t("jobs.onMap", { name })} label={null} />
              </div>
            ))}
          <Text fz="sm" data-testid="cell">
            {t(isMet(map, place) ? "jobs.cellMet" : "jobs.cellMissed", { objective: objective === null ? "–" : formatNumber(objective) })}
          </Text>
          {chosen && (
            <Button variant="default" onClick={() => onChoose?.(null)}>
              {t("jobs.backToBest")}
            </Button>
          )}
        </Stack>
      </Group>
    </section>
  );
}
