import { Group, NativeSelect, Slider, Stack, Text, Title, useComputedColorScheme } from "@mantine/core";
import { useMemo, useState } from "react";
import { useTranslation } from "react-i18next";
import { Chart } from "@/shared/charts/Chart";
import { axisOf, inks, SEQUENTIAL } from "@/shared/charts/inks";
import { formatNumber, named, withUnit } from "@/shared/units/format";
import { nearest, sliceOf, type GridMap } from "./map";

interface Props {
  map: GridMap;
  /** Where the values shown on the page lie. */
  values: Record<string, number>;
  /** The way of the best point through the search. */
  path: Record<string, number>[];
  units: Map<string, string>;
}

/** The objective over two of the variables, as a map; of further variables a slice. */
export function MapView({ map, values, path, units }: Props) {
  const { t } = useTranslation();
  const dark = useComputedColorScheme("light") === "dark";
  const names = Object.keys(map.axes);
  const [x, setX] = useState(names[0]!);
  const [y, setY] = useState(names[1]!);
  const others = names.filter((name) => name !== x && name !== y);
  const [moved, setMoved] = useState<Record<string, number>>({});
  const at = useMemo(() => Object.fromEntries(others.map((name) => [name, moved[name] ?? nearest(map.axes[name]!, values[name] ?? 0)])), [others.join(), moved, map, values]);
  const option = useMemo(() => {
    const cells = sliceOf(map, x, y, at);
    const known = cells.flatMap((cell) => (cell.objective === null ? [] : [cell.objective]));
    const [low, high] = [Math.min(...known), Math.max(...known)];
    // Penalties of unstable corners would leave one colour for all the rest.
    const log = low > 0 && high / low > 20;
    const level = (objective: number) => (log ? Math.log10(objective) : objective);
    const { ink, mark, paper } = inks(dark);
    const category = (name: string) => axisOf(named(name, units.get(name) ?? ""), dark, { type: "category", data: map.axes[name]!.map((v) => formatNumber(v, 3)), scale: undefined, splitLine: { show: false } });
    const place = (point: Record<string, number>) => [nearest(map.axes[x]!, point[x] ?? NaN), nearest(map.axes[y]!, point[y] ?? NaN)];
    const text = (cell: (typeof cells)[number]) => `${x} = ${withUnit(map.axes[x]![cell.x]!, units.get(x) ?? "")}\n${y} = ${withUnit(map.axes[y]![cell.y]!, units.get(y) ?? "")}\n${t("jobs.objective")} ${cell.objective === null ? "–" : formatNumber(cell.objective)}${cell.met ? "" : `\n${t("jobs.missed")}`}`;
    return {
      grid: { left: 70, right: 90, top: 12, bottom: 48 },
      tooltip: { renderMode: "richText", backgroundColor: paper, textStyle: { color: ink }, formatter: (hit: { seriesType: string; dataIndex: number }) => (hit.seriesType === "heatmap" ? text(cells[hit.dataIndex]!) : "") },
      xAxis: category(x),
      yAxis: { ...category(y), nameGap: 54 },
      visualMap: { min: level(low), max: level(high), calculable: false, right: 4, top: "middle", text: [formatNumber(high, 3), formatNumber(low, 3)], textStyle: { color: ink }, inRange: { color: SEQUENTIAL }, seriesIndex: 0 },
      series: [
        { type: "heatmap", name: "map", data: cells.map((cell) => ({ value: [cell.x, cell.y, cell.objective === null ? "-" : level(cell.objective)], itemStyle: { opacity: cell.met ? 1 : 0.28 } })) },
        { type: "line", name: "path", data: path.map(place), symbol: "circle", symbolSize: 5, lineStyle: { color: mark, width: 1.5, type: "dashed" }, itemStyle: { color: mark }, silent: true },
        { type: "scatter", name: "best", data: [place(values)], symbol: "diamond", symbolSize: 17, itemStyle: { color: mark, borderColor: dark ? "#000" : "#fff", borderWidth: 2 }, silent: true },
      ],
    };
  }, [map, x, y, at, values, path, units, dark, t]);
  const choice = (other: string) => names.filter((name) => name !== other);
  return (
    <section data-testid="map">
      <Title order={2} mb={4}>
        {t("jobs.map")}
      </Title>
      <Text fz="sm" c="dimmed" mb="xs">
        {t("jobs.mapDoc")}
      </Text>
      <Stack gap="xs" maw={760}>
        {names.length > 2 && (
          <Group gap="sm" align="flex-end">
            <NativeSelect size="xs" label={t("jobs.across")} value={x} data={choice(y)} onChange={(event) => setX(event.currentTarget.value)} />
            <NativeSelect size="xs" label={t("jobs.upwards")} value={y} data={choice(x)} onChange={(event) => setY(event.currentTarget.value)} />
            {others.map((name) => (
              <div key={name} style={{ width: 180 }}>
                <Text fz="xs">
                  {name} = {withUnit(map.axes[name]![at[name]!]!, units.get(name) ?? "")}
                </Text>
                <Slider size="sm" min={0} max={map.axes[name]!.length - 1} value={at[name]!} onChange={(next) => setMoved((before) => ({ ...before, [name]: next }))} thumbLabel={name} label={null} />
              </div>
            ))}
          </Group>
        )}
        <Chart option={option} height={380} summary={t("jobs.mapSummary", { x, y })} />
      </Stack>
    </section>
  );
}
