import type { EChartsCoreOption } from "echarts/core";
import { decadeText, extent, logRange } from "@/shared/plots/ranges";
import { stroke } from "@/shared/plots/palette";
import type { Axis, Numbers } from "@/shared/plots/types";

/** A line of an analysis chart; `band` is what holds the truth with a stated probability. */
export interface AnalysisLine {
  label: string;
  x: Numbers;
  y: Numbers;
  band?: { lower: Numbers; upper: Numbers };
  kind?: "line" | "points" | "bars";
  /** Its place in the palette; by default its place among the lines. */
  color?: number;
}

export interface AnalysisSpec {
  title: string;
  x: Axis;
  y: Axis & { min?: number; max?: number };
  lines: AnalysisLine[];
  /** Lines to be compared with: a bound, a limit. */
  marks?: { x?: number; y?: number; label: string }[];
  /** Stretches of x that are told apart: the part that did not estimate, the worst interval. */
  zones?: { from: number; to: number; label: string }[];
}

const named = (axis: Axis) => (axis.unit ? `${axis.label} [${axis.unit}]` : axis.label);
const finite = (value: number | undefined) => value !== undefined && Number.isFinite(value);
const drawable = (axis: Axis, value: number | undefined) => finite(value) && (!axis.log || value! > 0);

/** Pairs of a line; a missing value is a gap, and a logarithmic axis has no place for what is not positive. */
export function pairs(spec: AnalysisSpec, line: Pick<AnalysisLine, "x" | "y">): [number, number | null][] {
  const found: [number, number | null][] = [];
  for (let i = 0; i < line.x.length; i++) if (drawable(spec.x, line.x[i])) found.push([line.x[i]!, drawable(spec.y, line.y[i]) ? line.y[i]! : null]);
  return found;
}

/** The outline of a band: along its lower edge, and back along the upper one. */
function outline(spec: AnalysisSpec, line: AnalysisLine): [number, number, number][] {
  const found: [number, number, number][] = [];
  const { lower, upper } = line.band!;
  for (let i = 0; i < line.x.length; i++) if (drawable(spec.x, line.x[i]) && drawable(spec.y, lower[i]) && drawable(spec.y, upper[i])) found.push([line.x[i]!, lower[i]!, upper[i]!]);
  return found;
}

/** What ECharts draws of it. */
export function optionOf(spec: AnalysisSpec, dark: boolean): EChartsCoreOption {
  const ink = dark ? "#d6dade" : "#24292e";
  const grid = dark ? "#3a3f45" : "#e4e7ea";
  const quiet = dark ? "#9aa1a8" : "#6a7178";
  const axis = (own: AnalysisSpec["y"]) => ({
    type: own.log ? "log" : "value",
    name: named(own),
    nameLocation: "middle",
    scale: true,
    min: own.min,
    max: own.max,
    nameTextStyle: { color: ink, fontSize: 11 },
    axisLabel: { color: ink, fontSize: 11, hideOverlap: true, ...(own.log ? { formatter: decadeText } : {}) },
    axisLine: { show: true, onZero: false, lineStyle: { color: quiet } },
    splitLine: { lineStyle: { color: grid } },
  });
  // Left to itself a logarithmic axis goes on to whole decades, of which the last may be empty.
  const along = spec.x.log ? extent(spec.lines.map(({ x }) => Array.from(x).filter((value) => drawable(spec.x, value)))) : null;
  const [min, max] = along ? logRange(along) : [];
  const bands = spec.lines.flatMap((line, i) => {
    if (!line.band) return [];
    const points = outline(spec, line);
    return [
      {
        type: "custom",
        name: line.label,
        silent: true,
        clip: true,
        z: 1,
        data: points,
        encode: { x: 0, y: [1, 2] },
        tooltip: { show: false },
        // One polygon for the whole band, drawn with its first point.
        renderItem: (parameters: { dataIndex: number }, at: { coord(point: [number, number]): number[] }) =>
          parameters.dataIndex > 0 ? null : { type: "polygon", shape: { points: [...points.map(([x, low]) => at.coord([x, low])), ...points.toReversed().map(([x, , high]) => at.coord([x, high]))] }, style: { fill: stroke(line.color ?? i, dark).color, opacity: 0.2 } },
      },
    ];
  });
  const lines = spec.lines.map((line, i) => {
    const { color, dash } = stroke(line.color ?? i, dark);
    const common = { name: line.label, data: pairs(spec, line), z: 3 };
    if (line.kind === "points") return { ...common, type: "scatter", symbolSize: 6, itemStyle: { color } };
    if (line.kind === "bars") return { ...common, type: "bar", barMaxWidth: 4, itemStyle: { color } };
    return { ...common, type: "line", showSymbol: false, sampling: "minmax", connectNulls: false, lineStyle: { color, width: 1.5, type: dash.length ? dash : "solid" }, itemStyle: { color } };
  });
  const reference = {
    type: "line",
    name: "",
    data: [],
    silent: true,
    markLine: { symbol: "none", silent: true, lineStyle: { color: quiet, type: [4, 3] }, label: { color: ink, fontSize: 11, formatter: "{b}", position: "insideEndTop" }, data: (spec.marks ?? []).map((mark) => ({ name: mark.label, ...(mark.x !== undefined ? { xAxis: mark.x } : { yAxis: mark.y }) })) },
    markArea: { silent: true, itemStyle: { color: dark ? "rgba(255,157,92,0.14)" : "rgba(184,74,0,0.08)" }, label: { color: ink, fontSize: 11, position: "insideTop" }, data: (spec.zones ?? []).map((zone) => [{ name: zone.label, xAxis: zone.from }, { xAxis: zone.to }]) },
  };
  return {
    animation: false,
    textStyle: { fontFamily: "system-ui, sans-serif" },
    grid: { left: 64, right: 18, top: 10, bottom: 42 },
    xAxis: { ...axis({ ...spec.x, min, max }), nameGap: 24 },
    yAxis: { ...axis(spec.y), nameGap: 46 },
    tooltip: { trigger: "axis", confine: true, backgroundColor: dark ? "#1f2225" : "#ffffff", borderColor: quiet, textStyle: { color: ink, fontSize: 12 }, valueFormatter: (value: unknown) => (typeof value === "number" ? String(Number(value.toPrecision(5))) : "–") },
    dataZoom: [{ type: "inside", filterMode: "none", zoomOnMouseWheel: "ctrl", moveOnMouseWheel: false }],
    series: [...bands, ...lines, reference],
  };
}
