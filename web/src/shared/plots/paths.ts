import uPlot from "uplot";
import { drawLine, drawPath } from "./lines";
import type { Series } from "./types";

/** Pixels that nobody sees: by so much a drawn line may pass its points, and points of one spot lie apart. */
const UNSEEN = 0.15;
const SPOT = 0.5;
/** Points of a pixel's width. */
const MOST = 4;

/** Where values lie on the canvas. */
export function positions(u: uPlot, key: "x" | "y", values: ArrayLike<number | null>): Float64Array<ArrayBuffer> {
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
export function drawAligned(): uPlot.Series.PathBuilder {
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
export function drawFree(series: Series): uPlot.Series.PathBuilder {
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
