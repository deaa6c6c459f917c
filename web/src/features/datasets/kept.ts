import type { TFunction } from "i18next";
import type { AnalysisSpec } from "@/shared/charts/analysis";
import { prettyUnit, words } from "@/shared/units/format";

type Values = (number | null)[];
interface Variant {
  metrics?: Record<string, Record<string, { unit: string }>>;
  parameters?: Record<string, unknown>;
  time?: Values;
  outputs?: Record<string, Values>;
  frequency?: Values;
  magnitude?: Values;
  phase?: Values;
}

const plain = (values: Values | undefined): Float64Array => Float64Array.from(values ?? [], (value) => value ?? NaN);
const DEGREES = 180 / Math.PI;

/** The curves of a kept simulation or frequency response, a chart for each quantity; of other kinds none. `units` are those of the system's outputs, as far as they are known. */
export function curvesOf(kind: string, result: Record<string, unknown>, t: TFunction, units: ReadonlyMap<string, string> = new Map()): AnalysisSpec[] {
  const variants = (result.variants ?? []) as Variant[];
  const label = ({ parameters }: Variant) => Object.entries(parameters ?? {}).map(([path, value]) => `${path} = ${typeof value === "number" ? value : JSON.stringify(value)}`).join(", ") || t("results.asIs");
  if (kind === "simulation") {
    // A peak has the unit of its output: that of one whose system is not stored.
    const unitOf = (output: string) => units.get(output) ?? variants.flatMap((one) => one.metrics?.[output]?.peak?.unit ?? [])[0] ?? "";
    const outputs = [...new Set(variants.flatMap((one) => Object.keys(one.outputs ?? {})))];
    return outputs.map((output) => ({ title: words(output), x: { label: t("panel.time"), unit: "s" }, y: { label: words(output), unit: prettyUnit(unitOf(output)) }, lines: variants.map((one) => ({ label: label(one), x: plain(one.time), y: plain(one.outputs?.[output]) })) }));
  }
  if (kind !== "frequency_response") return [];
  const x = { label: "ω", unit: "rad/s", log: true };
  return [
    { title: t("panel.magnitude"), x, y: { label: t("panel.magnitudeShort"), unit: "dB" }, lines: variants.map((one) => ({ label: label(one), x: plain(one.frequency), y: plain(one.magnitude).map((size) => 20 * Math.log10(size)) })) },
    { title: t("panel.phase"), x, y: { label: t("panel.phaseShort"), unit: "°" }, lines: variants.map((one) => ({ label: label(one), x: plain(one.frequency), y: plain(one.phase).map((angle) => angle * DEGREES) })) },
  ];
}
