import type { LiveParameter, Opened } from "@/shared/live/protocol";
import type { Scale } from "./scale";
import { readGoal, writeGoal, type PanelGoal } from "@/shared/responses/goals";

/** Settings that were kept, to come back to or to be seen beside others. */
export interface Snapshot {
  name: string;
  /** Drawn as a curve of its own. */
  shown: boolean;
  values: Record<string, number>;
}

/** A recorded channel over the curve of an output. */
export interface Overlay {
  output: string;
  dataset: string;
  channel: string;
  start: number;
  relative: boolean;
}

/** What the strip can show: metrics that need nothing but the curves. The first are shown until somebody chooses. */
const USUAL = ["rise_time", "response_time", "settling_time", "overshoot", "peak", "steady_state_error", "bandwidth", "phase_margin", "gain_margin", "sensitivity_peak", "damping_ratio"];

/** What follows no reference has no error: its output is another quantity than its input. */
export function usualMetrics(loops: readonly string[]): string[] {
  return loops.length > 0 ? USUAL : USUAL.filter((name) => name !== "steady_state_error");
}
export const MEASURABLE = [...USUAL, "peak_time", "undershoot", "delay_margin", "complementary_peak", "critical_frequency", "iae", "ise", "itae", "control_effort", "max_velocity", "max_acceleration"];

/** What a front panel shows; all of it stands in its address. */
export interface PanelState {
  /** Parameters with a slider. */
  sliders: string[];
  /** Values that differ from the document's. */
  values: Record<string, number>;
  /** One parameter at several values, each a curve beside the moving one. */
  compare: { path: string; values: number[] } | null;
  /** Values of the pinned reference, those that differ from the document's. */
  reference: Record<string, number> | null;
  input: string | null;
  amplitude: number;
  /** The output whose metrics are shown. */
  output: string | null;
  loop: string | null;
  path: [string, string] | null;
  /** Parameters that are turned instead of pushed. */
  knobs: string[];
  /** Where the travel is to be other than the parameter's own. */
  scales: Record<string, Scale>;
  goals: PanelGoal[];
  snapshots: Snapshot[];
  measured: Overlay[];
  /** Seconds; null lets the service choose. */
  duration: number | null;
  /** Plots in their order: `step:position`, `bode`, `phase`, `nyquist`, `poles`, `spectrum:position`. */
  plots: string[] | null;
  /** Metrics in the strip; null stands for the usual ones. */
  metrics: string[] | null;
  /** The metric whose influences lie behind the labels; null: the first that anything has an influence on. */
  metric: string | null;
}

const OWN = new Set(["s", "cmp", "in", "amp", "out", "loop", "path", "T", "v", "ref", "k", "log", "lin", "g", "sn", "ds", "ms", "m"]);
/** Between the parts of a snapshot or an overlay in the address. */
const PART = "~";

export function readState(query: URLSearchParams): PanelState {
  const list = (key: string): string[] | null => query.get(key)?.split(",").filter(Boolean) ?? null;
  const prefixed = (prefix: string): Record<string, number> => {
    const found: Record<string, number> = {};
    for (const [key, text] of query) {
      const value = Number(text);
      if (key.startsWith(prefix) && text !== "" && Number.isFinite(value)) found[key.slice(prefix.length)] = value;
    }
    return found;
  };
  const [path, listed] = (query.get("cmp") ?? "").split(":");
  const compared = (listed ?? "").split(",").filter(Boolean).map(Number).filter(Number.isFinite);
  const pair = list("path");
  const duration = Number(query.get("T"));
  const amplitude = Number(query.get("amp") ?? 1);
  const metrics = (list("ms") ?? []).filter((name) => MEASURABLE.includes(name));
  return {
    sliders: list("s") ?? [],
    values: prefixed("p."),
    compare: path && compared.length > 0 ? { path, values: compared } : null,
    reference: query.has("ref") ? prefixed("r.") : null,
    input: query.get("in"),
    amplitude: Number.isFinite(amplitude) && amplitude !== 0 ? amplitude : 1,
    output: query.get("out"),
    loop: query.get("loop"),
    path: pair?.length === 2 ? [pair[0]!, pair[1]!] : null,
    duration: Number.isFinite(duration) && duration > 0 ? duration : null,
    plots: list("v"),
    metrics: metrics.length > 0 ? metrics : null,
    metric: query.get("m"),
    knobs: list("k") ?? [],
    scales: Object.fromEntries([...(list("log") ?? []).map((path) => [path, "log"]), ...(list("lin") ?? []).map((path) => [path, "linear"])]) as Record<string, Scale>,
    goals: (list("g") ?? []).flatMap(readGoal),
    snapshots: query.getAll("sn").flatMap(readSnapshot),
    measured: query.getAll("ds").flatMap(readOverlay),
  };
}

export function writeState(state: PanelState, before: URLSearchParams): URLSearchParams {
  const query = new URLSearchParams();
  for (const [key, value] of before) if (!OWN.has(key) && !/^[pr]\./.test(key)) query.append(key, value);
  const put = (key: string, value: string | number | null | undefined) => {
    if (value !== null && value !== undefined && value !== "") query.set(key, String(value));
  };
  put("s", state.sliders.join(","));
  for (const [path, value] of Object.entries(state.values)) put(`p.${path}`, round(value));
  if (state.compare) put("cmp", `${state.compare.path}:${state.compare.values.join(",")}`);
  if (state.reference) {
    put("ref", 1);
    for (const [path, value] of Object.entries(state.reference)) put(`r.${path}`, round(value));
  }
  put("in", state.input);
  if (state.amplitude !== 1) put("amp", state.amplitude);
  put("out", state.output);
  put("loop", state.loop);
  if (state.path) put("path", state.path.join(","));
  put("T", state.duration);
  put("v", state.plots?.join(","));
  put("ms", state.metrics?.join(","));
  put("m", state.metric);
  put("k", state.knobs.join(","));
  for (const [key, scale] of [["log", "log"], ["lin", "linear"]] as const) put(key, Object.keys(state.scales).filter((path) => state.scales[path] === scale).join(","));
  put("g", state.goals.map(writeGoal).join(","));
  for (const { name, shown, values } of state.snapshots) query.append("sn", [name, shown ? 1 : 0, ...Object.entries(values).map(([path, value]) => `${path}=${round(value)}`)].join(PART));
  for (const { output, dataset, channel, start, relative } of state.measured) query.append("ds", [output, dataset, channel, start, relative ? 1 : 0].join(PART));
  return query;
}

function readSnapshot(text: string): Snapshot[] {
  const [name = "", shown, ...parts] = text.split(PART);
  const values = Object.fromEntries(parts.map((part) => part.split("=")).map(([path, value]) => [path, Number(value)]));
  return name !== "" && Object.values(values).every((value) => Number.isFinite(value)) ? [{ name, shown: shown === "1", values }] : [];
}

function readOverlay(text: string): Overlay[] {
  const [output, dataset, channel, start, relative] = text.split(PART);
  return output && dataset && channel && Number.isFinite(Number(start)) ? [{ output, dataset, channel, start: Number(start), relative: relative === "1" }] : [];
}

function round(value: number): number {
  return Number(value.toPrecision(8));
}

export interface Variant {
  label: string;
  kind: "current" | "reference" | "snapshot" | "compare";
  vector: number[];
}

/** Of one message: the service takes no more. */
const MOST_VARIANTS = 12;

/** Everything that is computed at once: the moving values, the reference, the snapshots, the comparisons. */
export function variantsOf(state: PanelState, parameters: Map<string, LiveParameter>, moving: Record<string, number>, names: { current: string; reference: string }, show: (path: string, value: number) => string): { paths: string[]; variants: Variant[] } {
  const paths = pathsOf(state, parameters);
  const at = (values: Record<string, number>) => paths.map((path) => values[path] ?? parameters.get(path)!.value);
  const variants: Variant[] = [{ label: names.current, kind: "current", vector: at(moving) }];
  if (state.reference) variants.push({ label: names.reference, kind: "reference", vector: at(state.reference) });
  for (const { name, shown, values } of state.snapshots) if (shown) variants.push({ label: name, kind: "snapshot", vector: at(values) });
  if (state.compare && paths.includes(state.compare.path)) {
    for (const value of state.compare.values) variants.push({ label: show(state.compare.path, value), kind: "compare", vector: at({ ...moving, [state.compare.path]: value }) });
  }
  return { paths, variants: variants.slice(0, MOST_VARIANTS) };
}

/** What the vectors of the live channel are made of, in this order. */
export function pathsOf(state: PanelState, parameters: Map<string, LiveParameter>): string[] {
  const wanted = [...state.sliders, ...Object.keys(state.values), ...Object.keys(state.reference ?? {}), ...state.snapshots.flatMap((kept) => Object.keys(kept.values)), ...(state.compare ? [state.compare.path] : [])];
  return [...new Set(wanted)].filter((path) => parameters.has(path) && !parameters.get(path)!.bound).slice(0, 50);
}

export function mainOutput(state: PanelState, opened: Pick<Opened, "outputs">): string {
  return opened.outputs.find((o) => o.name === state.output)?.name ?? opened.outputs[0]!.name;
}
