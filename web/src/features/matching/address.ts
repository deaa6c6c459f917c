import type { Scalar } from "@/shared/api/types";
import type { Parameters } from "@/shared/forms/address";
import type { Opened } from "@/shared/live/protocol";
import { readScenarios } from "@/shared/systems/scenarios";

/** A recording, and which of its channels is which signal. */
export interface Recorded {
  dataset: string;
  inputs: Record<string, string>;
  outputs: Record<string, string>;
  /** What inputs do between their samples, where it is not to be tried out. */
  between?: Record<string, string>;
}

export const WAYS = ["hold", "linear", "band_limited"] as const;

/** What both forms are about, in the address: `system`, `dataset`, `in.<port>` and `out.<output>` with their channels, `between.<port>`. */
export interface Match extends Recorded {
  system: string;
}

/** One of several recordings, with what is known of it alone. */
export interface Experiment extends Recorded {
  /** The share that estimates: 1 all of it, 0 none. */
  split: number;
  /** Parameters that had another value: `load = 25 kg; current = 0.5`. */
  known: string;
}

export function readMatch(query: URLSearchParams): Match {
  const found: Match = { system: query.get("system") ?? "", dataset: query.get("dataset") ?? "", inputs: {}, outputs: {} };
  for (const [key, value] of query) {
    if (key.startsWith("in.")) found.inputs[key.slice(3)] = value;
    else if (key.startsWith("out.")) found.outputs[key.slice(4)] = value;
    else if (key.startsWith("between.")) found.between = { ...found.between, [key.slice(8)]: value };
  }
  return found;
}

export function writeMatch(query: URLSearchParams, match: Match): URLSearchParams {
  const next = new URLSearchParams([...query].filter(([key]) => !/^(in|out|between)\.|^(system|dataset)$/.test(key)));
  if (match.system) next.set("system", match.system);
  if (match.dataset) next.set("dataset", match.dataset);
  for (const [port, channel] of Object.entries(match.inputs)) if (channel) next.set(`in.${port}`, channel);
  for (const [output, channel] of Object.entries(match.outputs)) if (channel) next.set(`out.${output}`, channel);
  for (const [port, way] of Object.entries(match.between ?? {})) if (way) next.set(`between.${port}`, way);
  return next;
}

/** Further recordings beside the first one, which stand in the address as `more`. */
export function readMore(query: URLSearchParams): Experiment[] {
  const text = (value: unknown) => (typeof value === "string" ? value : "");
  const ports = (value: unknown) => Object.fromEntries(Object.entries(typeof value === "object" && value !== null ? value : {}).map(([port, channel]) => [port, text(channel)]));
  try {
    const found: unknown = JSON.parse(query.get("more") ?? "[]");
    if (!Array.isArray(found)) return [];
    return (found as Partial<Experiment>[]).map((one) => ({ dataset: text(one.dataset), inputs: ports(one.inputs), outputs: ports(one.outputs), ...(one.between ? { between: ports(one.between) } : {}), split: typeof one.split === "number" ? one.split : 0.5, known: text(one.known) }));
  } catch {
    return [];
  }
}

export function writeMore(query: URLSearchParams, more: Experiment[]): URLSearchParams {
  const next = new URLSearchParams(query);
  if (more.length > 0) next.set("more", JSON.stringify(more));
  else next.delete("more");
  return next;
}

/** Only the ports that have a channel: what a request names. */
export function given(ports: Record<string, string>): Record<string, string> {
  return Object.fromEntries(Object.entries(ports).filter(([, channel]) => channel !== ""));
}

/** The inputs of a request: a channel, and what it does between its samples where that is said. */
export function driven({ inputs, between = {} }: Pick<Recorded, "inputs" | "between">): Record<string, string | { channel: string; between_samples: string }> {
  return Object.fromEntries(Object.entries(given(inputs)).map(([port, channel]) => [port, between[port] ? { channel, between_samples: between[port] } : channel]));
}

/** What is known of one recording alone; undefined where it cannot be read. */
export function readKnown(text: string): Record<string, Scalar> | undefined {
  const lines = readScenarios(text.replaceAll("\n", ";"));
  return lines === undefined ? undefined : (lines[0] ?? {});
}

/** Where the recordings stand in a request: one beside its system, several as experiments. */
export function recordingsOf(match: Match, first: { split: number; known: string }, more: Experiment[]): Record<string, unknown> {
  const one = (recorded: Recorded) => ({ dataset: recorded.dataset, inputs: driven(recorded), outputs: given(recorded.outputs) });
  if (more.length === 0 && first.known.trim() === "") return { ...one(match), split: first.split };
  const experiments = [{ ...match, ...first }, ...more].map((each) => ({ ...one(each), split: each.split, parameters: readKnown(each.known) ?? {} }));
  return { experiments };
}

/** The places of a recording in a request that have a field: what is wrong elsewhere, such as that nothing is matched at all, is told below the form. */
export function placesOf(opened: Pick<Opened, "inputs" | "outputs"> | undefined, before = ""): string[] {
  const ports = [...(opened?.inputs ?? []).map((name) => `inputs/${name}`), ...(opened?.outputs ?? []).map(({ name }) => `outputs/${name}`)];
  return ["dataset", "split", ...ports].map((place) => `${before}/${place}`);
}

/** A parameter that is sought, with the bounds that it keeps to. */
export interface Sought {
  path: string;
  lower?: Bound | undefined;
  upper?: Bound | undefined;
}
type Bound = Exclude<Scalar, string>;

/** The parameters that an address names as `p`, with their bounds as `bounds`; where it names none, those that a form begins with. */
export function readSought(query: URLSearchParams, all: string[], begin: string[]): Sought[] {
  const named = query.has("p") ? query.get("p")!.split(",").filter((path) => all.includes(path)) : begin;
  let bounds: Record<string, unknown> = {};
  try {
    bounds = Object(JSON.parse(query.get("bounds") ?? "{}")) as Record<string, unknown>;
  } catch {
    // An address that was cut short holds no bounds.
  }
  return named.map((path) => {
    const [lower, upper] = Array.isArray(bounds[path]) ? (bounds[path] as unknown[]).map(readBound) : [];
    return { path, ...(lower !== undefined ? { lower } : {}), ...(upper !== undefined ? { upper } : {}) };
  });
}

function readBound(given: unknown): Bound | undefined {
  if (typeof given === "number") return given;
  const { value, unit } = Object(given) as { value?: unknown; unit?: unknown };
  return typeof value === "number" && typeof unit === "string" ? { value, unit } : undefined;
}

export function writeSought(sought: Sought[], begin: string[]): Parameters {
  const named = sought.map(({ path }) => path).join(",");
  const bounds = Object.fromEntries(sought.flatMap(({ path, lower, upper }) => (lower === undefined && upper === undefined ? [] : [[path, [lower ?? null, upper ?? null]]])));
  return { p: named === begin.join(",") ? null : named, bounds: Object.keys(bounds).length > 0 ? JSON.stringify(bounds) : null };
}
