import type uPlot from "uplot";
import { paintBehind, paintMarks } from "./decor";
import { drawnSeries } from "./export";
import { drawLine } from "./lines";
import { drawFree, positions } from "./paths";
import type { Axis, Curve, Decor, PlotSpec, Series } from "./types";

const FONT = "11px system-ui, sans-serif";
/** Room for title and legend above the picture, px. */
const HEAD = 44;
/** Pixels by which a line of a picture that may be enlarged passes its points. */
const FINE = 0.02;

/** Where lines of the grid are, and what stands at them. */
export type Ticks = Record<"x" | "y", { at: number; text: string }[]>;

/** The picture with its title and legend, which on the page are text. */
export function pngOf(source: HTMLCanvasElement, spec: PlotSpec, drawn: readonly Series[]): Promise<Blob> {
  const unit = devicePixelRatio;
  const canvas = document.createElement("canvas");
  canvas.width = source.width;
  canvas.height = source.height + HEAD * unit;
  const ctx = canvas.getContext("2d")!;
  ctx.fillStyle = paperOf(spec);
  ctx.fillRect(0, 0, canvas.width, canvas.height);
  ctx.scale(unit, unit);
  paintHead(ctx, spec, drawn);
  ctx.setTransform(1, 0, 0, 1, 0, 0);
  ctx.drawImage(source, 0, HEAD * unit);
  return new Promise((resolve, reject) => canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("no picture")))));
}

const paperOf = (spec: PlotSpec) => (spec.dark ? "#1a1b1e" : "#ffffff");
const inkOf = (spec: PlotSpec) => (spec.dark ? "#d6dade" : "#24292e");

/** Title and legend, as on the page: a cross where a series is drawn as crosses. */
function paintHead(ctx: CanvasRenderingContext2D, spec: PlotSpec, drawn: readonly Series[]): void {
  ctx.fillStyle = inkOf(spec);
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
}

/** The same picture as an SVG document, drawn by the same painters on a context that writes one; the library comes when it is asked for. */
export async function svgOf(u: uPlot, spec: PlotSpec, curves: readonly Curve[], decor: Decor, ticks: Ticks): Promise<Blob> {
  const { Context } = await import("svgcanvas/dist/svgcanvas.esm.js");
  const unit = devicePixelRatio;
  const [width, height] = [u.ctx.canvas.width, u.ctx.canvas.height];
  const ctx = new Context(width, height + HEAD * unit);
  const svg = ctx.getSvg();
  svg.setAttribute("viewBox", `0 0 ${width} ${height + HEAD * unit}`);
  svg.setAttribute("width", String(width / unit));
  svg.setAttribute("height", String(height / unit + HEAD));
  ctx.fillStyle = paperOf(spec);
  ctx.fillRect(0, 0, width, height + HEAD * unit);
  ctx.save();
  ctx.scale(unit, unit);
  paintHead(ctx, spec, drawnSeries(spec.series, [...curves]));
  ctx.restore();
  ctx.translate(0, HEAD * unit);
  // What paints on a plot asks it for its context only.
  const plot = Object.create(u, { ctx: { value: ctx } }) as uPlot;
  paintAxes(plot, spec, ticks);
  paintBehind(plot, spec, decor);
  paintCurves(plot, spec, curves);
  paintMarks(plot, spec, decor.marks);
  return new Blob([ctx.getSerializedSvg()], { type: "image/svg+xml" });
}

function paintAxes(u: uPlot, spec: PlotSpec, ticks: Ticks): void {
  const { ctx } = u;
  const unit = devicePixelRatio;
  const { left, top, width, height } = u.bbox;
  const label = ({ label: name, unit: of }: Axis) => (of ? `${name} [${of}]` : name);
  ctx.font = `${11 * unit}px system-ui, sans-serif`;
  ctx.lineWidth = unit;
  ctx.strokeStyle = spec.dark ? "#3a3f45" : "#e4e7ea";
  ctx.fillStyle = inkOf(spec);
  const rule = (x0: number, y0: number, x1: number, y1: number) => {
    ctx.beginPath();
    ctx.moveTo(x0, y0);
    ctx.lineTo(x1, y1);
    ctx.stroke();
  };
  for (const { at, text } of ticks.x) {
    const x = u.valToPos(at, "x", true);
    if (at === null || !(x >= left - 1 && x <= left + width + 1)) continue;
    rule(x, top, x, top + height);
    ctx.textAlign = "center";
    ctx.fillText(text, x, top + height + 16 * unit);
  }
  for (const { at, text } of ticks.y) {
    const y = u.valToPos(at, "y", true);
    if (at === null || !(y >= top - 1 && y <= top + height + 1)) continue;
    rule(left, y, left + width, y);
    ctx.textAlign = "right";
    ctx.fillText(text, left - 7 * unit, y + 4 * unit);
  }
  ctx.textAlign = "center";
  ctx.fillText(label(spec.x), left + width / 2, top + height + 31 * unit);
  ctx.save();
  ctx.translate(12 * unit, top + height / 2);
  ctx.rotate(-Math.PI / 2);
  ctx.fillText(label(spec.y), 0, 0);
  ctx.restore();
  ctx.textAlign = "left";
}

function paintCurves(u: uPlot, spec: PlotSpec, curves: readonly Curve[]): void {
  const { ctx } = u;
  const { left, top, width, height } = u.bbox;
  const unit = devicePixelRatio;
  // Of a plane, a series has its own x, and is painted by itself.
  if (spec.equal || spec.free) return spec.series.forEach((series, i) => void (curves[i] && drawFree(series)(u, i + 1, 0, 0)));
  ctx.save();
  ctx.beginPath();
  ctx.rect(left, top, width, height);
  ctx.clip();
  spec.series.forEach((series, i) => {
    const curve = curves[i];
    if (!curve) return;
    const [x, y] = [positions(u, "x", curve.x as ArrayLike<number>), positions(u, "y", curve.y as ArrayLike<number>)];
    ctx.strokeStyle = series.color;
    ctx.globalAlpha = series.faint ? 0.4 : 1;
    ctx.lineWidth = (series.width ?? 1.5) * unit;
    ctx.setLineDash(series.dash.map((d) => d * unit));
    ctx.beginPath();
    if (series.marks) for (let k = 0; k < x.length; k++) {
      if (!Number.isFinite(x[k]! + y[k]!)) continue;
      ctx.moveTo(x[k]! + 2.5 * unit, y[k]!);
      ctx.arc(x[k]!, y[k]!, 2.5 * unit, 0, 2 * Math.PI);
    } else drawLine(ctx, x, y, FINE * unit);
    ctx.stroke();
  });
  ctx.restore();
}
