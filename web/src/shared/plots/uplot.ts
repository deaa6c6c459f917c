import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import { axisWidth, clamped, decadeText, equalRanges, extent, padded, planeOf, tickTexts, withReturns, type Range } from "./ranges";
import { paintBehind, paintMarks } from "./decor";
import { drawnSeries } from "./export";
import { Handles } from "./handles";
import { drawLine, drawPath } from "./lines";
import { NOTHING, type Curve, type LivePlot, type PlotSpec, type Series, type ZoneMoved } from "./types";

const FONT = "11px system-ui, sans-serif";

/** Pixels that nobody sees: by so much a drawn line may pass its points, and points of one spot lie apart. */
const UNSEEN = 0.15;
const SPOT = 0.5;
/** Points of a pixel's width. */
const MOST = 4;

/** Where values lie on the canvas. */
function positions(u: uPlot, key: "x" | "y", values: ArrayLike<number | null>): Float64Array<ArrayBuffer> {
  const { min, max, distr } = u.scales[key]!;
  const { left, top, width, height } = u.bbox;
  const found = new Float64Array(values.length);
  const of = distr === 3 ? Math.log10 : (value: number) => value;
  const first = of(min!);
  const part = 1 / (of(max!) - first);
  const [from, size] = key === "x" ? [left, width * part] : [top + height, -height * part];
  for (let i = 0; i < found.length; i++) found[i] = from + (of(values[i] ?? NaN) - first) * size;
  return found;
}

/** Lines over one x, with as few corners as can be seen; where many points share a pixel uPlot draws how far they reach. */
function drawAligned(): uPlot.Series.PathBuilder {
  const dense = uPlot.paths.linear!();
  // All series of a plot have one x: it is brought onto the canvas once for each picture.
  let along = { x: null as unknown, key: "", at: new Float64Array() };
  return (u, index, from, to) => {
    const x = u.data[0] as ArrayLike<number>;
    if (to - from > MOST * u.bbox.width) return dense(u, index, from, to);
    const key = [u.scales.x!.min, u.scales.x!.max, u.bbox.left, u.bbox.width].join();
    if (along.x !== x || along.key !== key) along = { x, key, at: positions(u, "x", x) };
    const stroke = new Path2D();
    drawLine(stroke, along.at, positions(u, "y", u.data[index] as ArrayLike<number>), UNSEEN * devicePixelRatio);
    return { stroke, fill: null, clip: null, flags: 1 };
  };
}

/** Lines and marks of series that have their own x each, which uPlot (mode 2) leaves to its user. */
function drawFree(series: Series): uPlot.Series.PathBuilder {
  return (u, index) => {
    const [xs, ys] = u.data[index] as unknown as [ArrayLike<number>, ArrayLike<number>];
    const ctx = u.ctx;
    const { left, top, width, height } = u.bbox;
    ctx.save();
    ctx.beginPath();
    ctx.rect(left, top, width, height);
    ctx.clip();
    ctx.strokeStyle = series.color;
    ctx.globalAlpha = series.faint ? 0.4 : 1;
    ctx.lineWidth = (series.width ?? 1.5) * devicePixelRatio;
    ctx.setLineDash(series.dash.map((d) => d * devicePixelRatio));
    ctx.beginPath();
    if (series.marks) {
      ctx.setLineDash([]);
      const r = 4.5 * devicePixelRatio;
      for (let i = 0; i < xs.length; i++) {
        if (!Number.isFinite(xs[i]!)) continue;
        const x = u.valToPos(xs[i]!, "x", true);
        const y = u.valToPos(ys[i]!, "y", true);
        if (series.marks === "cross") {
          ctx.moveTo(x - r, y - r);
          ctx.lineTo(x + r, y + r);
          ctx.moveTo(x + r, y - r);
          ctx.lineTo(x - r, y + r);
        } else {
          ctx.moveTo(x + r, y);
          ctx.arc(x, y, r, 0, 2 * Math.PI);
        }
      }
    } else drawPath(ctx, positions(u, "x", xs), positions(u, "y", ys), SPOT * devicePixelRatio);
    ctx.stroke();
    ctx.restore();
    return null;
  };
}

/** Draws curves on a canvas: aligned ones (all of one x) with uPlot's own paths, others in a plane. */
export function createUPlot(element: HTMLElement, spec: PlotSpec, onCursor: (text: string) => void, grips?: { layer: HTMLElement; moved: ZoneMoved }, onZoom?: (from: number, to: number) => void): LivePlot {
  const ink = spec.dark ? "#d6dade" : "#24292e";
  const grid = { stroke: spec.dark ? "#3a3f45" : "#e4e7ea", width: 1 };
  let current: Curve[] = [];
  let decor = NOTHING;
  let handles: Handles | null = null;
  let lastY: Range | null = null;
  let plane: { x: Range; y: Range } | null = null;
  const label = (axis: { label: string; unit: string }) => (axis.unit ? `${axis.label} [${axis.unit}]` : axis.label);
  const axis = (own: { label: string; unit: string; log?: boolean }, size: uPlot.Axis.Size): uPlot.Axis => ({
    stroke: ink,
    grid,
    ticks: grid,
    font: FONT,
    labelFont: FONT,
    labelSize: 16,
    labelGap: 0,
    size,
    label: label(own),
    ...(own.log ? { values: (_u: uPlot, splits: number[]) => splits.map((v) => (Math.abs(Math.log10(v) % 1) < 1e-9 ? decadeText(v) : "")) } 
      : { values: (_u: uPlot, splits: number[], _axis: number, _space: number, step: number) => tickTexts(splits, step) }),
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
  const series: unknown[] = spec.equal
    ? [null, ...spec.series.map((s) => ({ label: s.label, stroke: s.color, paths: drawFree(s), facets: [{ scale: "x", auto: true }, { scale: "y", auto: true }] }))]
    : [
        { label: spec.x.label },
        ...spec.series.map((s) => ({ label: s.label, stroke: s.color, ...(s.marks ? {} : { paths: aligned }), alpha: s.faint ? 0.4 : 1, width: s.marks ? 0 : (s.width ?? 1.5), dash: s.dash, points: s.marks ? { show: true, size: 5, stroke: s.color } : { show: false } })),
      ];
  const empty: unknown[] = spec.equal ? [null, ...spec.series.map(() => [[NaN, NaN], [NaN, NaN]])] : [[1, 2], ...spec.series.map(() => [null, null])];
  const decimals = (value: number) => Number(value.toPrecision(4)).toString();
  const options: uPlot.Options = {
    width: Math.max(element.clientWidth, 60),
    height: Math.max(element.clientHeight, 60),
    mode: spec.equal ? 2 : 1,
    legend: { show: false },
    padding: [8, 20, 0, 0],
    cursor: { show: true, x: true, y: true, points: { show: !spec.equal }, drag: { x: !spec.equal, y: false, setScale: onZoom === undefined } },
    scales: spec.equal
      ? { x: { time: false, range: () => plane?.x ?? [-1, 1] }, y: { range: () => plane?.y ?? [-1, 1] } }
      : { x: { time: false, distr: spec.x.log ? 3 : 1 }, y: { range: yRange } },
    // Both axes of a plane are alike by their sizes, which therefore stay.
    axes: [axis(spec.x, 34), axis(spec.y, spec.equal ? 58 : (_u, texts) => axisWidth(texts, 58))],
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
    const seen = planeOf(counting(), [...(spec.keep ?? []), ...edges], spec.clamp);
    plane = equalRanges(seen.x, seen.y, plot.bbox.width, plot.bbox.height);
  };
  const draw = () => {
    if (spec.equal) findPlane();
    const data = spec.equal ? [null, ...current.map((c) => [c.x, c.y])] : [current[0]?.x ?? [0, 1], ...current.map((c) => c.y)];
    // batch() commits at its end, so that the picture is drawn before this returns.
    plot.batch(() => plot.setData(data as unknown as uPlot.AlignedData));
  };
  const observer = new ResizeObserver(() => {
    plot.setSize({ width: element.clientWidth, height: element.clientHeight });
    // Only new data are asked for both ranges anew: redraw() would keep that of x, and a circle would become an ellipse.
    if (spec.equal && current.length > 0) draw();
  });
  observer.observe(element);
  return {
    update(curves, behind = NOTHING) {
      current = curves;
      decor = behind;
      draw();
    },
    png: () => new Promise((resolve, reject) => composed(plot.ctx.canvas, spec, drawnSeries(spec.series, current)).toBlob((blob) => (blob ? resolve(blob) : reject(new Error("no picture"))))),
    destroy() {
      observer.disconnect();
      handles?.destroy();
      plot.destroy();
    },
  };
}

/** The picture with its title and legend, which on the page are text. */
function composed(source: HTMLCanvasElement, spec: PlotSpec, drawn: readonly Series[]): HTMLCanvasElement {
  const unit = devicePixelRatio;
  const canvas = document.createElement("canvas");
  canvas.width = source.width;
  canvas.height = source.height + 44 * unit;
  const ctx = canvas.getContext("2d")!;
  ctx.fillStyle = spec.dark ? "#1a1b1e" : "#ffffff";
  ctx.fillRect(0, 0, canvas.width, canvas.height);
  ctx.scale(unit, unit);
  ctx.fillStyle = spec.dark ? "#d6dade" : "#24292e";
  ctx.font = "600 13px system-ui, sans-serif";
  ctx.fillText(spec.title, 10, 17);
  ctx.font = FONT;
  let x = 10;
  for (const s of drawn) {
    ctx.strokeStyle = s.color;
    ctx.globalAlpha = s.faint ? 0.4 : 1;
    ctx.lineWidth = s.width ?? 1.5;
    ctx.setLineDash(s.dash);
    ctx.beginPath();
    ctx.moveTo(x, 34);
    ctx.lineTo(x + 26, 34);
    ctx.stroke();
    ctx.globalAlpha = 1;
    ctx.fillText(s.label, x + 31, 38);
    x += 45 + ctx.measureText(s.label).width;
  }
  ctx.setTransform(1, 0, 0, 1, 0, 0);
  ctx.drawImage(source, 0, 44 * unit);
  return canvas;
}
