import type { Curve, PlotSpec, Series } from "./types";

/** The series of which anything can be seen: an earlier setting that there is none of has no curve. */
export function drawnSeries(series: readonly Series[], curves: readonly Curve[]): Series[] {
  return series.filter((_, i) => Array.from(curves[i]?.y ?? []).some(Number.isFinite));
}

export function download(name: string, content: Blob): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

/** A drawn SVG as a picture of pixels, twice as many as are on the page. */
export async function rasterised(svg: SVGElement, paper: string): Promise<Blob> {
  const { width, height } = svg.getBoundingClientRect();
  const address = URL.createObjectURL(new Blob([new XMLSerializer().serializeToString(svg)], { type: "image/svg+xml" }));
  try {
    const image = new Image();
    image.src = address;
    await image.decode();
    const canvas = document.createElement("canvas");
    canvas.width = 2 * Math.round(width);
    canvas.height = 2 * Math.round(height);
    const ctx = canvas.getContext("2d")!;
    ctx.fillStyle = paper;
    ctx.fillRect(0, 0, canvas.width, canvas.height);
    ctx.drawImage(image, 0, 0, canvas.width, canvas.height);
    return await new Promise((resolve, reject) => canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error("no picture")))));
  } finally {
    URL.revokeObjectURL(address);
  }
}

export function fileName(title: string, ending: string): string {
  return `${title.toLowerCase().replace(/[^\p{L}\p{N}]+/gu, "-").replace(/^-|-$/g, "") || "plot"}.${ending}`;
}

/** One pair of columns for each curve, units in the header. */
export function csvOf(spec: Pick<PlotSpec, "x" | "y" | "series">, all: Curve[]): string {
  const drawn = drawnSeries(spec.series, all);
  const curves = all.filter((_, i) => drawn.includes(spec.series[i]!));
  const quoted = (text: string) => `"${text.replaceAll('"', '""')}"`;
  const unit = (axis: { label: string; unit: string }) => (axis.unit ? `${axis.label} [${axis.unit}]` : axis.label);
  const header = drawn.flatMap((s) => [quoted(`${s.label}: ${unit(spec.x)}`), quoted(`${s.label}: ${unit(spec.y)}`)]);
  const rows = Math.max(0, ...curves.map((c) => c.x.length));
  const lines = [header.join(",")];
  for (let i = 0; i < rows; i++) lines.push(curves.flatMap((c) => [cell(c.x[i]), cell(c.y[i])]).join(","));
  return lines.join("\n") + "\n";
}

function cell(value: number | undefined): string {
  return value === undefined || !Number.isFinite(value) ? "" : String(value);
}
