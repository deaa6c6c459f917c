import type { Block, Connection, ElementEntry, SystemDocument } from "@/shared/api/types";

/** A diagram as its document says it: ports, endpoints, and edits that return a new document. */

export type Catalogue = ReadonlyMap<string, ElementEntry>;
export interface Ports {
  inputs: string[];
  outputs: string[];
}

/** The ports of a block; those of some kinds follow from their values, as in the catalogue. */
export function portsOf(block: Block, catalogue: Catalogue): Ports {
  if (block.system) {
    const inner = block.system;
    return { inputs: Object.keys(inner.blocks).filter((name) => inner.blocks[name]!.kind === "input"), outputs: Object.keys(inner.outputs) };
  }
  const entry = catalogue.get(block.kind);
  const ports = { inputs: [...(entry?.inputs ?? [])], outputs: [...(entry?.outputs ?? [])] };
  const numbered = (count: number, name: string) => Array.from({ length: count }, (_, i) => `${name}${i + 1}`);
  if (block.kind === "sum") ports.inputs = numbered(String(block.signs ?? "++").length, "in");
  else if (block.kind === "multiplication") ports.inputs = numbered(String(block.operations ?? "**").length, "in");
  else if (block.kind === "function") {
    const used = [...String(block.expression ?? "").matchAll(/\bu([1-9]\d?)\b/g)].map((match) => Number(match[1]));
    ports.inputs = numbered(Math.max(0, ...used), "u");
  } else if (block.kind === "user_equations") {
    ports.inputs = Array.isArray(block.inputs) ? (block.inputs as string[]) : [];
    ports.outputs = Array.isArray(block.outputs) ? (block.outputs as string[]) : [];
  } else if (block.kind === "state_space" || block.kind === "discrete_state_space") {
    const wide = (value: unknown): number => (Array.isArray(value) && Array.isArray(value[0]) ? value[0].length : 1);
    const inputs = wide(block.D);
    const outputs = Array.isArray(block.D) ? block.D.length : 1;
    ports.inputs = Array.isArray(block.inputs) ? (block.inputs as string[]) : inputs === 1 ? ["in"] : numbered(inputs, "in");
    ports.outputs = Array.isArray(block.outputs) ? (block.outputs as string[]) : outputs === 1 ? ["out"] : numbered(outputs, "out");
  } else if ((block.setpoint_weight_p !== undefined || block.setpoint_weight_d !== undefined) && /^(p|pi|pd|pid|pd2|sampled_pid)$/.test(block.kind)) ports.inputs = ["reference", "measurement"];
  return ports;
}

export interface End {
  block: string;
  port: string;
}

export function endOf(text: string, document: SystemDocument, catalogue: Catalogue, side: keyof Ports): End {
  const [block = "", port] = text.split(".");
  if (port) return { block, port };
  const found = document.blocks[block];
  return { block, port: (found && portsOf(found, catalogue)[side][0]) ?? (side === "inputs" ? "in" : "out") };
}

/** A block with one port needs no name for it. */
export function textOf(end: End, document: SystemDocument, catalogue: Catalogue, side: keyof Ports): string {
  const block = document.blocks[end.block];
  return block && portsOf(block, catalogue)[side].length === 1 ? end.block : `${end.block}.${end.port}`;
}

export const NAME = /^[A-Za-z][A-Za-z0-9_]*$/;

/** Case counts, but two names of one scope must differ in more than that. */
export function isTaken(name: string, taken: Iterable<string>): boolean {
  return [...taken].some((other) => other.toLowerCase() === name.toLowerCase());
}

export function freeName(wanted: string, taken: Iterable<string>): string {
  const used = new Set([...taken].map((name) => name.toLowerCase()));
  const base = NAME.test(wanted) ? wanted : "block";
  if (!used.has(base.toLowerCase())) return base;
  for (let number = 2; ; number++) if (!used.has(`${base}_${number}`.toLowerCase())) return `${base}_${number}`;
}

export function connectionsOf(document: SystemDocument): Connection[] {
  return document.connections ?? [];
}

/** An input takes one signal: the new one replaces what was there. */
export function connect(document: SystemDocument, catalogue: Catalogue, from: End, to: End): SystemDocument {
  const kept = connectionsOf(document).filter((wire) => {
    const end = endOf(wire.to, document, catalogue, "inputs");
    return end.block !== to.block || end.port !== to.port;
  });
  return { ...document, connections: [...kept, { from: textOf(from, document, catalogue, "outputs"), to: textOf(to, document, catalogue, "inputs") }] };
}

export function disconnect(document: SystemDocument, catalogue: Catalogue, to: End): SystemDocument {
  return {
    ...document,
    connections: connectionsOf(document).filter((wire) => {
      const end = endOf(wire.to, document, catalogue, "inputs");
      return end.block !== to.block || end.port !== to.port;
    }),
  };
}

export function removeBlocks(document: SystemDocument, names: ReadonlySet<string>): SystemDocument {
  const gone = (end: string) => names.has(end.split(".")[0]!);
  return {
    ...document,
    blocks: Object.fromEntries(Object.entries(document.blocks).filter(([name]) => !names.has(name))),
    connections: connectionsOf(document).filter((wire) => !gone(wire.from) && !gone(wire.to)),
    outputs: Object.fromEntries(Object.entries(document.outputs).filter(([, end]) => !gone(end))),
  };
}

export function renameBlock(document: SystemDocument, before: string, after: string): SystemDocument {
  const moved = (end: string) => (end === before ? after : end.startsWith(`${before}.`) ? after + end.slice(before.length) : end);
  return {
    ...document,
    blocks: Object.fromEntries(Object.entries(document.blocks).map(([name, block]) => [name === before ? after : name, block])),
    connections: connectionsOf(document).map((wire) => ({ from: moved(wire.from), to: moved(wire.to) })),
    outputs: Object.fromEntries(Object.entries(document.outputs).map(([name, end]) => [name, moved(end)])),
  };
}

/** A fresh block of a kind, with the example's values for what must be given. */
export function blockOf(entry: ElementEntry): Block {
  if (entry.kind === "subsystem") return { kind: "subsystem", system: { blocks: { in: { kind: "input" }, gain: { kind: "gain", gain: 1 } }, connections: [{ from: "in", to: "gain" }], outputs: { out: "gain" } } };
  return { kind: entry.kind, ...entry.example } as Block;
}

/** Copies of blocks with the connections among them, under free names. */
export function pasted(document: SystemDocument, from: SystemDocument): { document: SystemDocument; names: string[] } {
  const blocks = { ...document.blocks };
  const renamed = new Map<string, string>();
  for (const [name, block] of Object.entries(from.blocks)) {
    const own = freeName(name, Object.keys(blocks));
    renamed.set(name, own);
    blocks[own] = structuredClone(block);
  }
  const moved = (end: string): string => {
    const [block = "", ...rest] = end.split(".");
    return [renamed.get(block) ?? block, ...rest].join(".");
  };
  const added = connectionsOf(from).map((wire) => ({ from: moved(wire.from), to: moved(wire.to) }));
  return { document: { ...document, blocks, connections: [...connectionsOf(document), ...added] }, names: [...renamed.values()] };
}

export function partOf(document: SystemDocument, names: ReadonlySet<string>): SystemDocument {
  const inside = (end: string) => names.has(end.split(".")[0]!);
  return {
    blocks: Object.fromEntries(Object.entries(document.blocks).filter(([name]) => names.has(name))),
    connections: connectionsOf(document).filter((wire) => inside(wire.from) && inside(wire.to)),
    outputs: {},
  };
}

/** The system inside of systems that `scope` names. */
export function scoped(document: SystemDocument, scope: readonly string[]): SystemDocument | undefined {
  return scope.reduce<SystemDocument | undefined>((found, name) => found?.blocks[name]?.system, document);
}

export function withScoped(document: SystemDocument, scope: readonly string[], edit: (inner: SystemDocument) => SystemDocument): SystemDocument {
  const [name, ...rest] = scope;
  if (name === undefined) return edit(document);
  const block = document.blocks[name];
  if (!block?.system) return document;
  return { ...document, blocks: { ...document.blocks, [name]: { ...block, system: withScoped(block.system, rest, edit) } } };
}

/** Connections that close a loop: those that lead back to where a walk from the inputs has come from. */
export function feedbackOf(document: SystemDocument): Set<string> {
  const next = new Map<string, string[]>();
  for (const wire of connectionsOf(document)) {
    const from = wire.from.split(".")[0]!;
    next.set(from, [...(next.get(from) ?? []), wire.to]);
  }
  const back = new Set<string>();
  const state = new Map<string, "open" | "done">();
  const starts = [...Object.keys(document.blocks).filter((name) => document.blocks[name]!.kind === "input"), ...Object.keys(document.blocks)];
  for (const start of starts) {
    if (state.has(start)) continue;
    // Depth first, without recursion: diagrams may be long chains.
    const stack: { name: string; rest: string[] }[] = [{ name: start, rest: [...(next.get(start) ?? [])] }];
    state.set(start, "open");
    while (stack.length > 0) {
      const top = stack[stack.length - 1]!;
      const to = top.rest.shift();
      if (to === undefined) {
        state.set(top.name, "done");
        stack.pop();
        continue;
      }
      const name = to.split(".")[0]!;
      if (state.get(name) === "open") back.add(to);
      else if (!state.has(name)) {
        state.set(name, "open");
        stack.push({ name, rest: [...(next.get(name) ?? [])] });
      }
    }
  }
  return back;
}

/** The inputs of a block that a loop comes back to. */
export function backOf(name: string, wires: readonly { to: End; back: boolean }[]): string[] {
  return wires.filter((wire) => wire.back && wire.to.block === name).map((wire) => wire.to.port);
}

/** A signal as an output of its system. */
export function withOutput(document: SystemDocument, catalogue: Catalogue, name: string, from: End): SystemDocument {
  return { ...document, outputs: { ...document.outputs, [name]: textOf(from, document, catalogue, "outputs") } };
}

/** Every block by its path, those inside of subsystems too. */
export function pathsOf(document: SystemDocument, prefix = ""): string[] {
  return Object.entries(document.blocks).flatMap(([name, block]) => [prefix + name, ...(block.system ? pathsOf(block.system, `${prefix}${name}.`) : [])]);
}
