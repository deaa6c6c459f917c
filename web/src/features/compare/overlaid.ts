import type { Metric } from "@/shared/api/types";
import type { Frame, Opened } from "@/shared/live/protocol";
import type { Design } from "./designs";
import type { Axes, Drawn } from "./study";

/** All designs as one system that has the outputs of each; of one name in two units, the first counts. */
export function openedOf(designs: readonly Design[], measured: Opened["measured"], end: number): Opened {
  const units = new Map(designs.toReversed().flatMap(({ outputs }) => [...outputs]));
  const names = [...new Set(designs.flatMap(({ outputs }) => [...outputs.keys()]))];
  return {
    type: "opened",
    system: null,
    inputs: [],
    outputs: names.map((name) => ({ name, unit: units.get(name)! })),
    parameters: [],
    curves: names,
    metrics: [],
    duration: end,
    nonlinear: designs.some(({ nonlinear }) => nonlinear),
    measured,
    warnings: [],
  };
}

/** The curves of all designs as one picture; what a design does not have is NaN. */
export function frameOf(seq: number, opened: Opened, designs: readonly Design[], drawn: readonly Drawn[], axes: Axes, samples: number): Frame {
  const numbers = (values: readonly (number | null)[] | undefined, length: number) => Float32Array.from({ length }, (_, i) => values?.[i] ?? NaN);
  const outputs = drawn.map((own, k) => opened.outputs.map(({ name, unit }) => numbers(designs[k]!.outputs.get(name) === unit ? own.outputs[name] : undefined, samples)));
  const responses = drawn.map(({ re, im }) => ({ re: numbers(re, axes.frequencies.length), im: numbers(im, axes.frequencies.length) }));
  const poles = drawn.map((own) => ({ re: Float32Array.from(own.poles, ({ real }) => real), im: Float32Array.from(own.poles, ({ imag }) => imag) }));
  return {
    seq,
    variants: drawn.map(({ verdict }) => ({ verdict })),
    time: Float32Array.from({ length: samples }, (_, i) => (axes.end * i) / (samples - 1)),
    frequency: Float32Array.from(axes.frequencies),
    outputs: (variant, output) => outputs[variant]![output]!,
    response: (variant) => responses[variant]!,
    poles: (variant) => poles[variant]!,
  };
}

export interface Row {
  kind: "metric" | "parameter";
  name: string;
  unit: string;
  /** One for each design, then one for each recording; null where it has none. */
  cells: (Metric | null)[];
}

/** Metrics first, those of designs before those of recordings, then the parameters that are not the same in all designs. */
export function rowsOf(designs: readonly Pick<Design, "parameters">[], metrics: readonly (Record<string, Metric> | undefined)[], names: readonly string[]): Row[] {
  const measured = names.flatMap((name): Row[] => {
    const cells = metrics.map((own) => own?.[name] ?? null);
    const found = cells.find((cell) => cell !== null);
    return found ? [{ kind: "metric", name, unit: found.unit, cells }] : [];
  });
  const paths = [...new Set(designs.flatMap(({ parameters }) => [...parameters.keys()]))];
  const differing = paths.flatMap((path): Row[] => {
    const own = designs.map(({ parameters }) => parameters.get(path));
    if (own.every((one) => one?.value === own[0]?.value && one?.unit === own[0]?.unit)) return [];
    return [{ kind: "parameter", name: path, unit: own.find((one) => one)!.unit, cells: [...own.map((one) => (one ? { ...one, verdict: "ok" } : null)), ...metrics.slice(designs.length).map(() => null)] }];
  });
  return [...measured, ...differing];
}

/** The table as CSV: in SI, with the verdict where there is no value. */
export function tableCsv(labels: readonly string[], rows: readonly Row[], heads: { property: string; unit: string }): string {
  const quoted = (text: string) => `"${text.replaceAll('"', '""')}"`;
  const lines = [[heads.property, heads.unit, ...labels].map(quoted), ...rows.map(({ name, unit, cells }) => [quoted(name), quoted(unit), ...cells.map((cell) => (cell === null ? "" : cell.value === null ? quoted(cell.verdict) : String(cell.value)))])];
  return lines.map((line) => line.join(",")).join("\n") + "\n";
}
