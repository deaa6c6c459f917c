import type { LiveParameter } from "@/shared/live/protocol";
import { readGoal, writeGoal, type PanelGoal } from "@/shared/responses/goals";
import { listIn, MEASURABLE, PART, readView, VIEW_KEYS, writeView, type View } from "@/shared/responses/view";
import type { Scale } from "./scale";

/** Settings that were kept, to come back to or to be seen beside others. */
export interface Snapshot {
  name: string;
  /** Drawn as a curve of its own. */
  shown: boolean;
  values: Record<string, number>;
}

/** What a front panel shows; all of it stands in its address. */
export interface PanelState extends View {
  /** Parameters with a slider. */
  sliders: string[];
  /** Values that differ from the document's. */
  values: Record<string, number>;
  /** One parameter at several values, each a curve beside the moving one. */
  compare: { path: string; values: number[] } | null;
  /** Values of the pinned reference, those that differ from the document's. */
  reference: Record<string, number> | null;
  /** Parameters that are turned instead of pushed. */
  knobs: string[];
  /** The parameter whose root locus is drawn among the poles. */
  locus: string | null;
  /** The parameter that follows a curve over frequency that is pulled; null: the controller's gain. */
  pull: string | null;
  /** Where the travel is to be other than the parameter's own. */
  scales: Record<string, Scale>;
  goals: PanelGoal[];
  snapshots: Snapshot[];
  /** Metrics in the strip; null stands for the usual ones. */
  metrics: string[] | null;
  /** The metric whose influences lie behind the labels; null: the first that anything has an influence on. */
  metric: string | null;
}

const OWN = new Set<string>([...VIEW_KEYS, "s", "cmp", "ref", "k", "rl", "pl", "log", "lin", "g", "sn", "ms", "m"]);

export function readState(query: URLSearchParams): PanelState {
  const list = (key: string) => listIn(query, key);
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
  const metrics = (list("ms") ?? []).filter((name) => MEASURABLE.includes(name));
  return {
    ...readView(query),
    sliders: list("s") ?? [],
    values: prefixed("p."),
    compare: path && compared.length > 0 ? { path, values: compared } : null,
    reference: query.has("ref") ? prefixed("r.") : null,
    metrics: metrics.length > 0 ? metrics : null,
    metric: query.get("m"),
    knobs: list("k") ?? [],
    locus: query.get("rl"),
    pull: query.get("pl"),
    scales: Object.fromEntries([...(list("log") ?? []).map((path) => [path, "log"]), ...(list("lin") ?? []).map((path) => [path, "linear"])]) as Record<string, Scale>,
    goals: (list("g") ?? []).flatMap(readGoal),
    snapshots: query.getAll("sn").flatMap(readSnapshot),
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
  writeView(state, query);
  put("ms", state.metrics?.join(","));
  put("m", state.metric);
  put("k", state.knobs.join(","));
  put("rl", state.locus);
  put("pl", state.pull);
  for (const [key, scale] of [["log", "log"], ["lin", "linear"]] as const) put(key, Object.keys(state.scales).filter((path) => state.scales[path] === scale).join(","));
  put("g", state.goals.map(writeGoal).join(","));
  for (const { name, shown, values } of state.snapshots) query.append("sn", [name, shown ? 1 : 0, ...Object.entries(values).map(([path, value]) => `${path}=${round(value)}`)].join(PART));
  return query;
}

function readSnapshot(text: string): Snapshot[] {
  const [name = "", shown, ...parts] = text.split(PART);
  const values = Object.fromEntries(parts.map((part) => part.split("=")).map(([path, value]) => [path, Number(value)]));
  return name !== "" && Object.values(values).every((value) => Number.isFinite(value)) ? [{ name, shown: shown === "1", values }] : [];
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
