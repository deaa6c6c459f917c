import type { Connection, Scalar, SystemDocument } from "@/shared/api/types";
import { readEntry } from "@/shared/units/number";

/** Between the ends of a connection that is named among parts: no block or port has it in its name. */
export const WIRE = " → ";

/** The parts of a system that a structure can do without. */
export function partsOf({ blocks, connections = [] }: SystemDocument): { blocks: string[]; connections: string[] } {
  return { blocks: Object.keys(blocks), connections: connections.map(({ from, to }) => from + WIRE + to) };
}

type Parts = Partial<Pick<SystemDocument, "parameters" | "blocks" | "connections" | "outputs">>;

/** Parts as JSON, as the diagram copies them or as a request names them; undefined where the text is something else. */
export function readParts(text: string): Parts | undefined {
  let found: unknown;
  try {
    found = JSON.parse(text);
  } catch {
    return undefined;
  }
  const record = (value: unknown): value is Record<string, unknown> => typeof value === "object" && value !== null && !Array.isArray(value);
  if (!record(found)) return undefined;
  const { parameters, blocks, connections, outputs } = found;
  const wires = connections === undefined || (Array.isArray(connections) && connections.every((wire) => record(wire) && typeof wire.from === "string" && typeof wire.to === "string"));
  if (!wires || [parameters, blocks, outputs].some((part) => part !== undefined && !record(part))) return undefined;
  const said = { parameters, blocks, connections: connections as Connection[] | undefined, outputs };
  const parts = Object.fromEntries(Object.entries(said).filter(([, part]) => part != null && Object.keys(part).length > 0));
  return Object.keys(parts).length > 0 ? (parts as Parts) : undefined;
}

export interface RangeOf {
  parameter: string;
  lower: Scalar;
  upper: Scalar;
}

/** Ranges as people write them, `lead.zero = 1 ... 100; m = 2 kg ... 5 kg`; undefined where a part cannot be read. */
export function readRanges(text: string): RangeOf[] | undefined {
  const found = text.split(/[;\n]/).filter((part) => part.trim() !== "").map((part): RangeOf | null => {
    const [, parameter, from, to] = /^\s*([A-Za-z][A-Za-z0-9_.]*)\s*=\s*(.+?)\s*(?:\.{2,3}|…)\s*(.+?)\s*$/.exec(part) ?? [];
    const [lower, upper] = [from, to].map((side) => {
      const entry = readEntry(side ?? "");
      return entry.kind === "number" ? entry.value : entry.kind === "quantity" ? { value: entry.value, unit: entry.unit } : undefined;
    });
    return parameter === undefined || lower === undefined || upper === undefined ? null : { parameter, lower, upper };
  });
  return found.includes(null) ? undefined : (found as RangeOf[]);
}
