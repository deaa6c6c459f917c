import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { axisWidth, clamped, decadeText, equalRanges, extent, logRange, padded, planeOf, tickTexts, withReturns, type Range } from "./ranges";
import { paintBehind, paintMarks } from "./decor";
import { drawnSeries } from "./export";
import { Handles } from "./handles";
import { drawAligned, drawFree } from "./paths";
import { pngOf, svgOf, type Ticks } from "./picture";
import { NOTHING, type Curve, type LivePlot, type PlotSpec, type ZoneMoved } from "./types";

const FONT = "11px system-ui, sans-serif";

/** Draws curves on a canvas: aligned ones (all of one x) with uPlot's own paths, others in a plane. */
export function createUPlot(element: HTMLElement, spec: PlotSpec, onCursor: (text: string) => void, grips?: { layer: HTMLElement; moved: ZoneMoved }, onZoom?: (from: number, to: number) => void): LivePlot {
  const ink = spec.dark ? "#d6dade" : "#24292e";
  const grid = { stroke: spec.dark ? "#3a3f45" : "#e4e7ea", width: 1 };
  let current: Curve[] = [];
  let decor = NOTHING;
  let handles: Handles | null = null;
  let lastY: Range | null = null;
  /** Curves with their own x each, which uPlot (mode 2) draws by our own paths. */
  const free = spec.equal || spec.free;
  let plane: { x: Range; y: Range } | null = null;
  const label = (axis: { label: string; unit: string }) => (axis.unit ? `${axis.label} [${axis.unit}]` : axis.label);
  // What stands at the axes, for the picture that is taken away.
  const ticks: Ticks = { x: [], y: [] };
  const told = (key: "x" | "y", splits: number[], texts: string[]): string[] => {
    ticks[key] = splits.map((at, i) => ({ at, text: texts[i]! }));
    return texts;
  };
  const axis = (key: "x" | "y", own: { label: string; unit: string; log?: boolean }, size: uPlot.Axis.Size): uPlot.Axis => ({
    stroke: ink,
    grid,
    ticks: grid,
    font: FONT,
    labelFont: FONT,
    labelSize: 16,
    labelGap: 0,
    size,
    label: label(own),
    values: (_u: uPlot, splits: number[], _axis: number, _space: number, step: number) => told(key, splits, own.log ? splits.map((v) => (Math.abs(Math.log10(v) % 1) < 1e-9 ? decadeText(v) : "")) : tickTexts(splits, step)),
  });
  /** Curves that the axes are made for: an earlier setting, unstable perhaps, does not flatten what is looked at. */
  const counting = () => current.filter((_, i) => !spec.series[i]?.faint);
  // Edges that can be taken are kept in sight, and the axis keeps still while one is held.
  const yRange = (): Range => {
    if (lastY && handles?.held) return lastY;
    const edges = decor.zones.flatMap((zone) => (zone.handle && zone.handle.axis !== "x" ? [zone.handle.at[1]] : []));
    const looked = counting().map((c) => c.y);
    const whole = clamped(padded(extent([...looked, ...(spec.keep ?? []).map((p) => [p[1]]), edges])), spec.clamp && withReturns(looked, spec.clamp));
    lastY = spec.span === undefined ? whole : [Math.max(whole[0], whole[1] - spec.span), whole[1]];
    return lastY;
  };
  const aligned = drawAligned();
  const series: unknown[] = free
    ? [null, ...spec.series.map((s) => ({ label: s.label, stroke: s.color, paths: drawFree(s), facets: [{ scale: "x", auto: true }, { scale: "y", auto: true }] }))]
    : [
        { label: spec.x.label },
        ...spec.series.map((s) => ({ label: s.label, stroke: s.color, ...(s.marks ? {} : { paths: aligned }), alpha: s.faint ? 0.4 : 1, width: s.marks ? 0 : (s.width ?? 1.5), dash: s.dash, points: s.marks ? { show: true, size: 5, stroke: s.color } : { show: false } })),
      ];
  const empty: unknown[] = free ? [null, ...spec.series.map(() => [[NaN, NaN], [NaN, NaN]])] : [[1, 2], ...spec.series.map(() => [null, null])];
  const decimals = (value: number) => Number(value.toPrecision(4)).toString();
  const options: uPlot.Options = {
    width: Math.max(element.clientWidth, 60),
    height: Math.max(element.clientHeight, 60),
    mode: free ? 2 : 1,
    legend: { show: false },
    padding: [8, 20, 0, 0],
    cursor: { show: true, x: true, y: true, points: { show: !free }, drag: { x: !free, y: false, setScale: onZoom === undefined } },
    scales: free
      ? { x: { time: false, range: () => plane?.x ?? [-1, 1] }, y: { range: () => plane?.y ?? [-1, 1] } }
      : { x: { time: false, ...(spec.x.log ? { distr: 3, range: (_u, low, high) => logRange([low ?? 1, high ?? 10]) } : {}) }, y: { range: yRange } },
    // Both axes of a plane are alike by their sizes, which therefore stay.
    axes: [axis("x", spec.x, 34), axis("y", spec.y, free ? 58 : (_u, texts) => axisWidth(texts, 58))],
    series: series as uPlot.Series[],
    hooks: {
      drawAxes: [(u) => paintBehind(u, spec, decor)],
      draw: [
        (u) => {
          paintMarks(u, spec, decor.marks);
          handles?.place(decor.zones);
        },
      ],
      setSelect: [
        (u) => {
          const { left, width } = u.select;
          if (!onZoom || width < 4) return;
          u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
          onZoom(u.posToVal(left, "x"), u.posToVal(left + width, "x"));
        },
      ],
      setCursor: [
        (u) => {
          const { left, top } = u.cursor;
          if (left === undefined || top === undefined || left < 0) return onCursor("");
          onCursor(`${decimals(u.posToVal(left, "x"))} ${spec.x.unit} · ${decimals(u.posToVal(top, "y"))} ${spec.y.unit}`);
        },
      ],
    },
  };
  const plot = new uPlot(options, empty as uPlot.AlignedData, element);
  if (grips) handles = new Handles(plot, grips.layer, grips.moved);
  const findPlane = () => {
    if (plane && handles?.held) return;
    const edges = decor.zones.flatMap((zone) => (zone.handle ? [zone.handle.at] : []));
    const seen = planeOf(counting(), [...(spec.keep ?? []), ...edges], spec.clamp, spec.clampX);
    plane = spec.equal ? equalRanges(seen.x, seen.y, plot.bbox.width, plot.bbox.height) : seen;
  };
  const draw = () => {
    if (free) findPlane();
    const data = free ? [null, ...current.map((c) => [c.x, c.y])] : [current[0]?.x ?? [0, 1], ...current.map((c) => c.y)];
    // batch() commits at its end, so that the picture is drawn before this returns.
    plot.batch(() => plot.setData(data as unknown as uPlot.AlignedData));
  };
  const observer = new ResizeObserver(() => {
    plot.setSize({ width: element.clientWidth, height: element.clientHeight });
    // Only new data are asked for both ranges anew: redraw() would keep that of x, and a circle would become an ellipse.
    if (free && current.length > 0) draw();
  });
  observer.observe(element);
  return {
    update(curves, behind = NOTHING) {
      current = curves;
      decor = behind;
      draw();
    },
    png: () => pngOf(plot.ctx.canvas, spec, drawnSeries(spec.series, current)),
    svg: () => svgOf(plot, spec, current, decor, ticks),
    destroy() {
      observer.disconnect();
      handles?.destroy();
      plot.destroy();
    },
  };
}
