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
