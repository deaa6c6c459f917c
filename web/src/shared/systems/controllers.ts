import type { Block, SystemDocument } from "@/shared/api/types";
import type { LiveParameter, Opened } from "@/shared/live/protocol";

/** Controllers, and which of their parameters are gains and times that are tuned. */
const TUNED: Record<string, readonly string[]> = {
  p: ["kp"],
  pi: ["kp", "ki", "integral_time"],
  pd: ["kp", "kd", "derivative_time"],
  pd2: ["kp", "kd1", "kd2"],
  pid: ["kp", "ki", "integral_time", "kd", "derivative_time"],
  sampled_pid: ["kp", "ki", "kd"],
  lead_lag: ["gain", "zero_frequency", "pole_frequency"],
};

/** Blocks through which a signal keeps its meaning: what limits it behind them limits it before. */
const PASSING = new Set(["sum", "delay", "zero_order_hold", "rate_limiter", "quantizer"]);
/** Limits that an actuator's input has by itself. */
const LIMITED: Record<string, readonly string[]> = { saturation: ["lower", "upper"], orifice_valve: ["stroke"], servo_valve: ["rated_current"] };
const FURTHEST = 8;

const blockAt = (end: string): string => end.split(".")[0]!;

/** The controllers of the outermost loop that has any, with the path to their system: `velocity_loop.`. */
function controllersOf(document: SystemDocument, prefix = ""): { prefix: string; names: string[]; document: SystemDocument } | null {
  const names = Object.entries(document.blocks).flatMap(([name, { kind }]) => (kind in TUNED ? [name] : []));
  if (names.length > 0) return { prefix, names, document };
  // A loop whose law is a plain factor behind its difference.
  const factors = Object.entries(document.blocks).flatMap(([name, { kind }]) => (kind === "gain" && (document.connections ?? []).some(({ from, to }) => blockAt(to) === name && isDifference(document.blocks[blockAt(from)])) ? [name] : []));
  if (factors.length > 0) return { prefix, names: factors, document };
  for (const [name, block] of Object.entries(document.blocks)) {
    const inside = block.system ? controllersOf(block.system, `${prefix}${name}.`) : null;
    if (inside) return inside;
  }
  return null;
}

const isDifference = (block: Block | undefined): boolean => block?.kind === "sum" && String(block.signs ?? "").includes("-");

/** The gains of the controller, or the author's parameters that stand for them; none of value 0, around which there is no range. */
export function gainsOf(document: SystemDocument, parameters: readonly LiveParameter[]): string[] {
  const found = controllersOf(document);
  if (!found) return [];
  const known = new Map(parameters.map((parameter) => [parameter.path, parameter]));
  const free = (path: string) => (known.get(path)?.bound === false && known.get(path)!.value !== 0 ? [path] : []);
  const paths = found.names.flatMap((name) => {
    const block = found.document.blocks[name]!;
    return (TUNED[block.kind] ?? ["gain"]).flatMap((key) => {
      const value = block[key];
      if (typeof value !== "string" || !value.startsWith("=")) return free(`${found.prefix}${name}.${key}`);
      return (value.match(/[A-Za-z_]\w*/g) ?? []).flatMap((own) => free(`${found.prefix}${own}`));
    });
  });
  return [...new Set(paths)];
}

export interface Effort {
  metric: "control_effort" | "max_acceleration";
  output: string;
  /** What the plant bears, in SI, and which parameter says so; null where nothing does. */
  limit: { value: number; by: string } | null;
}

/** Where the effort of a search can be read, and what limits it: the controller's signal or the actuator's; else the acceleration. */
export function effortOf(document: SystemDocument, { parameters, outputs }: Pick<Opened, "parameters" | "outputs">, main: string): Effort | null {
  const found = controllersOf(document);
  const name = found?.prefix === "" ? found.names[0] : undefined;
  const own = (path: string) => parameters.find((parameter) => parameter.path === path)?.value;
  const answer = blockAt(document.outputs[main] ?? "");
  const carried = new Map(Object.entries(document.outputs).flatMap(([output, from]) => (blockAt(from) === answer ? [] : [[blockAt(from), output] as const])));
  let here = name === undefined ? [] : [name];
  let output: string | undefined;
  const seen = new Set<string>();
  const limitOf = (block: string, keys: readonly string[]) => {
    const stated = keys.flatMap((key) => {
      const value = own(`${block}.${key}`);
      return value !== undefined && value !== 0 && Number.isFinite(value) ? [{ value: Math.abs(value), by: `${block}.${key}` }] : [];
    });
    return stated.sort((a, b) => a.value - b.value)[0] ?? null;
  };
  for (let step = 0; step < FURTHEST && here.length > 0; step++) {
    const next: string[] = [];
    for (const block of here) {
      seen.add(block);
      const kind = document.blocks[block]?.kind ?? "";
      if (output === undefined && carried.has(block)) {
        output = carried.get(block)!;
        const limit = limitOf(block, ["lower", "upper"]);
        if (limit) return { metric: "control_effort", output, limit };
      } else if (output !== undefined && kind in LIMITED) {
        const limit = limitOf(block, LIMITED[kind]!);
        if (limit) return { metric: "control_effort", output, limit };
      }
      // Behind the output only what leaves its signal as it is, is passed.
      if (output === undefined || carried.get(block) === output || PASSING.has(kind)) next.push(...(document.connections ?? []).flatMap(({ from, to }) => (blockAt(from) === block && !seen.has(blockAt(to)) && blockAt(to) !== answer ? [blockAt(to)] : [])));
    }
    here = next;
  }
  if (output !== undefined) return { metric: "control_effort", output, limit: null };
  const unit = outputs.find((one) => one.name === main)?.unit ?? "";
  return /^(m|rad)(\/s)?$/.test(unit) ? { metric: "max_acceleration", output: main, limit: null } : null;
}
