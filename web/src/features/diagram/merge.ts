import type { Block, SystemDocument } from "@/shared/api/types";
import { connectionsOf } from "./model";

/**
 * Three versions of a document become one, by block, connection and parameter: what only one side changed is taken from it;
 * where both did, differently, somebody has to choose.
 */
export type Side = "mine" | "theirs";
export interface Clash {
  /** Where: `blocks.motor.area`, `connections.error.in1`. */
  place: string;
  base: unknown;
  mine: unknown;
  theirs: unknown;
}
export interface Merged {
  merged: SystemDocument;
  clashes: Clash[];
  /** Connections and outputs of blocks that the other side had removed. */
  dropped: string[];
}

type Plain = Record<string, unknown>;

/** The merged document with a choice for each clash; mine stays where none is made. */
export function merge(base: SystemDocument, mine: SystemDocument, theirs: SystemDocument, choices: Readonly<Record<string, Side>> = {}): Merged {
  const clashes: Clash[] = [];
  const found = together("", keyed(base), keyed(mine), keyed(theirs), clashes, choices) as Plain;
  const dropped: string[] = [];
  return { merged: whole(found, "", dropped), clashes, dropped };
}

function together(place: string, base: unknown, mine: unknown, theirs: unknown, clashes: Clash[], choices: Readonly<Record<string, Side>>): unknown {
  if (same(mine, theirs) || same(base, theirs)) return mine;
  if (same(base, mine)) return theirs;
  if (divisible(place, mine, theirs)) {
    const before = isPlain(base) ? base : {};
    const found: Plain = {};
    for (const key of new Set([...Object.keys(mine as Plain), ...Object.keys(theirs as Plain)])) {
      const value = together(place ? `${place}.${key}` : key, before[key], (mine as Plain)[key], (theirs as Plain)[key], clashes, choices);
      if (value !== undefined) found[key] = value;
    }
    return found;
  }
  clashes.push({ place, base, mine, theirs });
  return choices[place] === "theirs" ? theirs : mine;
}

/** A quantity is one thing, and so is a block whose kind has changed, and a parameter whose unit has. */
function divisible(place: string, mine: unknown, theirs: unknown): boolean {
  if (!isPlain(mine) || !isPlain(theirs)) return false;
  if (/(^|\.)parameters\.[^.]+$/.test(place)) return same(mine.unit, theirs.unit);
  if (/(^|\.)blocks\.[^.]+$/.test(place)) return mine.kind === theirs.kind;
  return !("unit" in mine && "value" in mine);
}

/** Connections have no names: each is known by the input that it feeds, which takes one signal only. */
function keyed(document: SystemDocument): Plain {
  const connections = Object.fromEntries(connectionsOf(document).map((wire) => [wire.to, wire.from]));
  const blocks = Object.fromEntries(Object.entries(document.blocks).map(([name, block]) => [name, block.system ? { ...block, system: keyed(block.system) } : block]));
  return { ...document, blocks, connections };
}

function whole(found: Plain, place: string, dropped: string[]): SystemDocument {
  const blocks = Object.fromEntries(
    Object.entries((found.blocks ?? {}) as Record<string, Block>).map(([name, block]) => [name, block.system ? { ...block, system: whole(block.system as unknown as Plain, `${place}${name}.`, dropped) } : block]),
  );
  const there = (end: string) => blocks[end.split(".")[0]!] !== undefined;
  const wires = Object.entries((found.connections ?? {}) as Record<string, string>).map(([to, from]) => ({ from, to }));
  const outputs = Object.entries((found.outputs ?? {}) as Record<string, string>);
  for (const { from, to } of wires) if (!there(from) || !there(to)) dropped.push(`${place}${from} → ${to}`);
  for (const [name, from] of outputs) if (!there(from)) dropped.push(`${place}${from} → ${name}`);
  const document: SystemDocument = { ...(found as Partial<SystemDocument>), blocks, connections: wires.filter(({ from, to }) => there(from) && there(to)), outputs: Object.fromEntries(outputs.filter(([, from]) => there(from))) };
  return document;
}

function isPlain(value: unknown): value is Plain {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

export function same(a: unknown, b: unknown): boolean {
  if (a === b) return true;
  if (Array.isArray(a) && Array.isArray(b)) return a.length === b.length && a.every((item, i) => same(item, b[i]));
  if (isPlain(a) && isPlain(b)) {
    const keys = Object.keys(a);
    return keys.length === Object.keys(b).length && keys.every((key) => key in b && same(a[key], b[key]));
  }
  return false;
}
