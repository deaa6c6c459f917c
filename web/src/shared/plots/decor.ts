import type uPlot from "uplot";
import { drawPath } from "./lines";
import { positions } from "./paths";
import type { Band, Decor, Mark, PlotSpec, Shape } from "./types";

const FONT_SIZE = 11;

/** Paints what lies behind the curves: bands, forbidden zones, lines to compare with. */
export function paintBehind(u: uPlot, spec: PlotSpec, decor: Decor): void {
  within(u, (ctx) => {
    for (const band of decor.bands) paintBand(u, ctx, band);
    ctx.fillStyle = spec.dark ? "rgba(255,157,92,0.20)" : "rgba(184,74,0,0.13)";
    ctx.strokeStyle = spec.dark ? "#ff9d5c" : "#b84a00";
    ctx.lineWidth = devicePixelRatio;
    for (const zone of decor.zones) for (const shape of zone.shapes) paintShape(u, ctx, shape);
    if (spec.chart) paintChart(u, ctx, spec);
    ctx.strokeStyle = spec.dark ? "#9aa1a8" : "#6a7178";
    ctx.setLineDash([4 * devicePixelRatio, 3 * devicePixelRatio]);
    const { left, top, width, height } = u.bbox;
    for (const line of spec.lines ?? []) {
      ctx.beginPath();
      if (line.x !== undefined) {
        const x = u.valToPos(line.x, "x", true);
        ctx.moveTo(x, top);
        ctx.lineTo(x, top + height);
      }
      if (line.y !== undefined) {
        const y = u.valToPos(line.y, "y", true);
        ctx.moveTo(left, y);
        ctx.lineTo(left + width, y);
      }
      ctx.stroke();
    }
    if (spec.circle !== undefined) {
      ctx.beginPath();
      ctx.arc(u.valToPos(0, "x", true), u.valToPos(0, "y", true), radiusOf(u, spec.circle), 0, 2 * Math.PI);
      ctx.stroke();
    }
  });
}

/** Paints the distances that are read off the curves, over them. */
export function paintMarks(u: uPlot, spec: PlotSpec, marks: Mark[]): void {
  if (marks.length === 0) return;
  within(u, (ctx) => {
    const ink = spec.dark ? "#f2f4f5" : "#14171a";
    const paper = spec.dark ? "rgba(26,27,30,0.85)" : "rgba(255,255,255,0.85)";
    const unit = devicePixelRatio;
    ctx.font = `600 ${FONT_SIZE * unit}px system-ui, sans-serif`;
    ctx.textAlign = "left";
    ctx.textBaseline = "alphabetic";
    ctx.lineWidth = 2 * unit;
    for (const mark of marks) {
      const [x0, y0] = [u.valToPos(mark.from[0], "x", true), u.valToPos(mark.from[1], "y", true)];
      const [x1, y1] = [u.valToPos(mark.to[0], "x", true), u.valToPos(mark.to[1], "y", true)];
      ctx.strokeStyle = ctx.fillStyle = ink;
      ctx.beginPath();
      ctx.moveTo(x0, y0);
      ctx.lineTo(x1, y1);
      ctx.stroke();
      for (const [x, y] of [[x0, y0], [x1, y1]] as const) {
        ctx.beginPath();
        ctx.arc(x, y, 3 * unit, 0, 2 * Math.PI);
        ctx.fill();
      }
      const { left, top, width, height } = u.bbox;
      const size = ctx.measureText(mark.text).width;
      const x = Math.min(Math.max((x0 + x1) / 2 + 10 * unit, left + 2 * unit), left + width - size - 4 * unit);
      const y = Math.min(Math.max(lineOf([x0, y0], [x1, y1], unit), top + 12 * unit), top + height - 6 * unit);
      ctx.fillStyle = paper;
      ctx.fillRect(x - 2 * unit, y - FONT_SIZE * unit, size + 4 * unit, (FONT_SIZE + 4) * unit);
      ctx.fillStyle = ink;
      ctx.fillText(mark.text, x, y);
    }
  });
}

/** Where the text of a distance stands: above a level one, where the grip at its end leaves room; beyond the line that a short upright one is measured from, where it hides no curve; else at its middle. */
function lineOf([x0, y0]: [number, number], [x1, y1]: [number, number], unit: number): number {
  const [middle, size] = [(y0 + y1) / 2, Math.abs(y1 - y0)];
  if (size < 8 * unit) return middle - 14 * unit;
  if (size > 3 * FONT_SIZE * unit || Math.abs(x1 - x0) > 2 * unit) return middle;
  return y0 > y1 ? y0 + (FONT_SIZE + 6) * unit : y0 - 8 * unit;
}

/** The lines of a chart, thin, each with its text. */
function paintChart(u: uPlot, ctx: CanvasRenderingContext2D, spec: PlotSpec): void {
  const { x, y } = u.scales;
  const unit = devicePixelRatio;
  const lines = spec.chart!([x!.min!, x!.max!], [y!.min!, y!.max!]);
  ctx.save();
  ctx.strokeStyle = spec.dark ? "#5d656d" : "#c3c9cf";
  ctx.lineWidth = unit;
  for (const line of lines) {
    ctx.beginPath();
    drawPath(ctx, positions(u, "x", line.x), positions(u, "y", line.y), unit);
    ctx.stroke();
  }
  ctx.font = `${(FONT_SIZE - 1) * unit}px system-ui, sans-serif`;
  ctx.textAlign = "center";
  ctx.fillStyle = spec.dark ? "#aeb5bc" : "#5b6269";
  const written: { x: number; y: number; width: number }[] = [];
  for (const { text, at } of lines) {
    const here = { x: u.valToPos(at[0], "x", true), y: u.valToPos(at[1], "y", true) - 3 * unit, width: ctx.measureText(text).width };
    // Of texts that would lie over each other the first is written.
    if (written.some((other) => Math.abs(here.x - other.x) < (here.width + other.width) / 2 + 2 * unit && Math.abs(here.y - other.y) < FONT_SIZE * unit)) continue;
    written.push(here);
    ctx.fillText(text, here.x, here.y);
  }
  ctx.restore();
}

function within(u: uPlot, paint: (ctx: CanvasRenderingContext2D) => void): void {
  const { left, top, width, height } = u.bbox;
  u.ctx.save();
  u.ctx.beginPath();
  u.ctx.rect(left, top, width, height);
  u.ctx.clip();
  paint(u.ctx);
  u.ctx.restore();
}

function paintBand(u: uPlot, ctx: CanvasRenderingContext2D, { x, low, high, color }: Band): void {
  ctx.save();
  ctx.fillStyle = color;
  ctx.globalAlpha = 0.22;
  ctx.beginPath();
  let begun = false;
  const go = (i: number, value: number) => {
    if (!Number.isFinite(value)) return;
    const at: [number, number] = [u.valToPos(x[i]!, "x", true), u.valToPos(value, "y", true)];
    if (begun) ctx.lineTo(...at);
    else ctx.moveTo(...at);
    begun = true;
  };
  for (let i = 0; i < x.length; i++) go(i, high[i]!);
  for (let i = x.length - 1; i >= 0; i--) go(i, low[i]!);
  ctx.fill();
  ctx.restore();
}

function paintShape(u: uPlot, ctx: CanvasRenderingContext2D, shape: Shape): void {
  const { left, top, width, height } = u.bbox;
  ctx.beginPath();
  if (shape.kind === "box") {
    const at = (value: number, axis: "x" | "y", low: number, high: number) => (value === -Infinity ? low : value === Infinity ? high : u.valToPos(value, axis, true));
    // A pixel beyond the plot, so that only edges that mean something are seen.
    const x0 = at(shape.x[0], "x", left - 2, left + width + 2);
    const x1 = at(shape.x[1], "x", left - 2, left + width + 2);
    const y0 = at(shape.y[0], "y", top + height + 2, top - 2);
    const y1 = at(shape.y[1], "y", top + height + 2, top - 2);
    ctx.rect(Math.min(x0, x1), Math.min(y0, y1), Math.abs(x1 - x0), Math.abs(y1 - y0));
  } else if (shape.kind === "disc") {
    ctx.arc(u.valToPos(shape.center[0], "x", true), u.valToPos(shape.center[1], "y", true), radiusOf(u, shape.radius), 0, 2 * Math.PI);
  } else {
    const [x, y] = [u.valToPos(0, "x", true), u.valToPos(0, "y", true)];
    const far = 2 * (width + height);
    const [dx, dy] = [far * Math.cos(shape.angle), far * Math.sin(shape.angle)];
    ctx.moveTo(x - dx, y - dy);
    ctx.lineTo(x, y);
    ctx.lineTo(x - dx, y + dy);
    ctx.lineTo(x + far, y + far);
    ctx.lineTo(x + far, y - far);
    ctx.closePath();
  }
  ctx.fill();
  ctx.stroke();
}

function radiusOf(u: uPlot, radius: number): number {
  return Math.abs(u.valToPos(radius, "x", true) - u.valToPos(0, "x", true));
}
