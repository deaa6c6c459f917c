import type { Connection, ParameterDocument, SystemDocument } from "@/shared/api/types";
import { connectionsOf, endOf, freeName, textOf, type Catalogue } from "./model";

export interface Grouped {
  document: SystemDocument;
  name: string;
  /** Parameters that blocks on both sides of the new border use, and that are two now. */
  doubled: string[];
}

/**
 * Puts blocks into a system of their own. Signals that cross the border become its ports; inputs and outputs that are chosen
 * with the blocks go inside, and are ports there.
 */
export function grouped(document: SystemDocument, chosen: ReadonlySet<string>, outputs: ReadonlySet<string>, catalogue: Catalogue, wanted = "subsystem"): Grouped {
  const inside = new Set([...chosen].filter((name) => document.blocks[name]));
  const blocks = Object.fromEntries(Object.entries(document.blocks).filter(([name]) => inside.has(name)));
  const name = freeName(wanted, Object.keys(document.blocks).filter((other) => !inside.has(other)));
  const inner: SystemDocument = { name: title(name), blocks, connections: [], outputs: {} };
  const rest: Connection[] = [];
  const entries = new Map<string, string>();
  const exits = new Map<string, string>();
  const blockOf = (end: string) => end.split(".")[0]!;

  const exit = (from: string, as: string): string => {
    const end = endOf(from, document, catalogue, "outputs");
    const key = `${end.block}.${end.port}`;
    const port = exits.get(key) ?? freeName(as, Object.keys(inner.outputs));
    exits.set(key, port);
    inner.outputs[port] = from;
    return `${name}.${port}`;
  };
  for (const [output, from] of Object.entries(document.outputs)) if (outputs.has(output) && inside.has(blockOf(from))) inner.outputs[output] = from;
  for (const [output, from] of Object.entries(inner.outputs)) {
    const end = endOf(from, document, catalogue, "outputs");
    exits.set(`${end.block}.${end.port}`, output);
  }
  for (const wire of connectionsOf(document)) {
    const [leaves, arrives] = [inside.has(blockOf(wire.from)), inside.has(blockOf(wire.to))];
    if (leaves && arrives) inner.connections!.push(wire);
    else if (leaves) {
      const end = endOf(wire.from, document, catalogue, "outputs");
      rest.push({ from: exit(wire.from, end.port === "out" ? end.block : end.port), to: wire.to });
    } else if (arrives) {
      let port = entries.get(wire.from);
      if (port === undefined) {
        const end = endOf(wire.from, document, catalogue, "outputs");
        port = freeName(end.port === "out" ? end.block : end.port, Object.keys(inner.blocks));
        entries.set(wire.from, port);
        inner.blocks = { [port]: { kind: "input" }, ...inner.blocks };
        rest.push({ from: wire.from, to: `${name}.${port}` });
      }
      inner.connections!.push({ from: port, to: wire.to });
    } else rest.push(wire);
  }
  const kept = Object.fromEntries(Object.entries(document.outputs).flatMap(([output, from]) => (outputs.has(output) && inside.has(blockOf(from)) ? [] : [[output, inside.has(blockOf(from)) ? exit(from, output) : from]])));
  const outer: SystemDocument = { ...document, blocks: Object.fromEntries(Object.entries(document.blocks).filter(([other]) => !inside.has(other))), connections: [], outputs: kept };
  const doubled = shareParameters(document, inner, outer);
  outer.blocks[name] = { kind: "subsystem", system: inner };
  // A subsystem with one port is named without it.
  const short = (text: string, side: "inputs" | "outputs") => (blockOf(text) === name ? textOf(endOf(text, outer, catalogue, side), outer, catalogue, side) : text);
  outer.connections = rest.map((wire) => ({ from: short(wire.from, "outputs"), to: short(wire.to, "inputs") }));
  outer.outputs = Object.fromEntries(Object.entries(outer.outputs).map(([output, from]) => [output, short(from, "outputs")]));
  return { document: outer, name, doubled };
}

/** The other way round: what was inside stands beside the rest again, under names that are free there. */
export function dissolved(document: SystemDocument, name: string, catalogue: Catalogue): { document: SystemDocument; names: string[] } | undefined {
  const inner = document.blocks[name]?.system;
  if (!inner) return undefined;
  const blocks = Object.fromEntries(Object.entries(document.blocks).filter(([other]) => other !== name));
  const renamed = new Map<string, string>();
  const sources = new Map<string, string>();
  for (const wire of connectionsOf(document)) {
    const end = endOf(wire.to, document, catalogue, "inputs");
    if (end.block === name) sources.set(end.port, wire.from);
  }
  for (const [own, block] of Object.entries(inner.blocks)) {
    // A port that is fed from outside is a wire now; one that is not remains an input.
    if (block.kind === "input" && sources.has(own)) continue;
    const free = freeName(own, Object.keys(blocks));
    renamed.set(own, free);
    blocks[free] = block;
  }
  const moved = (text: string): string | undefined => {
    const [own = "", ...port] = text.split(".");
    const to = renamed.get(own);
    return to === undefined ? sources.get(own) : [to, ...port].join(".");
  };
  const outside = (from: string): string | undefined => {
    const end = endOf(from, document, catalogue, "outputs");
    return end.block === name ? (inner.outputs[end.port] === undefined ? undefined : moved(inner.outputs[end.port]!)) : from;
  };
  const wires: Connection[] = [];
  for (const wire of connectionsOf(document)) {
    if (endOf(wire.to, document, catalogue, "inputs").block === name) continue;
    const from = outside(wire.from);
    if (from !== undefined) wires.push({ from, to: wire.to });
  }
  for (const wire of connectionsOf(inner)) {
    const [from, to] = [moved(wire.from), moved(wire.to)];
    const through = from === undefined ? undefined : outside(from);
    if (through !== undefined && to !== undefined) wires.push({ from: through, to });
  }
  const outputs = Object.fromEntries(Object.entries(document.outputs).flatMap(([output, from]) => (outside(from) === undefined ? [] : [[output, outside(from)!]])));
  return { document: { ...document, parameters: { ...inner.parameters, ...document.parameters }, blocks, connections: wires, outputs }, names: [...renamed.values()] };
}

/** Expressions name parameters of their own system only, so those that the blocks use come along. */
function shareParameters(document: SystemDocument, inner: SystemDocument, outer: SystemDocument): string[] {
  const parameters = document.parameters ?? {};
  const used = (blocks: SystemDocument["blocks"]): Set<string> => {
    const found = new Set<string>();
    const add = (text: string) => {
      for (const [word] of text.matchAll(/[A-Za-z_]\w*/g)) {
        if (!parameters[word] || found.has(word)) continue;
        found.add(word);
        const value: unknown = parameters[word].value;
        if (typeof value === "string") add(value);
      }
    };
    const walk = (value: unknown): void => {
      if (typeof value === "string" && value.startsWith("=")) add(value);
      else if (Array.isArray(value)) value.forEach(walk);
    };
    for (const block of Object.values(blocks)) if (!block.system) Object.values(block).forEach(walk);
    return found;
  };
  const within = used(inner.blocks);
  const without = used(outer.blocks);
  const pick = (keep: (name: string) => boolean): Record<string, ParameterDocument> => Object.fromEntries(Object.entries(parameters).filter(([key]) => keep(key)));
  if (within.size > 0) {
    inner.parameters = pick((key) => within.has(key));
    const left = pick((key) => without.has(key) || !within.has(key));
    if (Object.keys(left).length > 0) outer.parameters = left;
    else delete outer.parameters;
  }
  return [...within].filter((key) => without.has(key));
}

const title = (name: string): string => (name[0]!.toUpperCase() + name.slice(1)).replaceAll("_", " ");
