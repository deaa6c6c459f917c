import type { SystemDocument } from "@/shared/api/types";

export interface Change {
  /** Where in the document: `blocks.motor.area`. */
  place: string;
  kind: "added" | "removed" | "changed";
  before?: string;
  after?: string;
}

/** What a reader would call the differences of two documents: blocks, values, connections; the order of keys is none. */
export function differences(before: SystemDocument, after: SystemDocument): Change[] {
  const found: Change[] = [];
  compare("", plain(before), plain(after), found);
  return found;
}

/** Connections have no names: each is a key of its own here, so that moving one in the list changes nothing. */
function plain(document: SystemDocument): Record<string, unknown> {
  const connections = Object.fromEntries((document.connections ?? []).map((wire) => [`${wire.from} → ${wire.to}`, true]));
  const blocks = Object.fromEntries(Object.entries(document.blocks).map(([name, block]) => [name, block.system ? { ...block, system: plain(block.system) } : block]));
  return { ...document, connections, blocks };
}

function compare(place: string, a: unknown, b: unknown, found: Change[]): void {
  if (JSON.stringify(a) === JSON.stringify(b)) return;
  if (isRecord(a) && isRecord(b) && !isQuantity(a) && !isQuantity(b)) {
    for (const key of new Set([...Object.keys(a), ...Object.keys(b)])) compare(place ? `${place}.${key}` : key, a[key], b[key], found);
    return;
  }
  if (a === undefined) found.push({ place, kind: "added", after: shownValue(b) });
  else if (b === undefined) found.push({ place, kind: "removed", before: shownValue(a) });
  else found.push({ place, kind: "changed", before: shownValue(a), after: shownValue(b) });
}

function isRecord(value: unknown): value is Record<string, unknown> {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

function isQuantity(value: Record<string, unknown>): boolean {
  return Object.keys(value).length === 2 && "value" in value && "unit" in value;
}

/** A value as a reader would write it: a quantity with its unit, a block by its kind. */
export function shownValue(value: unknown): string {
  if (value === true) return "";
  if (isRecord(value) && isQuantity(value)) return `${String(value.value)} ${String(value.unit)}`;
  if (isRecord(value) && typeof value.kind === "string") return value.kind;
  return typeof value === "string" ? value : JSON.stringify(value);
}
