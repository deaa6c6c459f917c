import type { Block, SystemDocument } from "@/shared/api/types";
import { connectionsOf, endOf, feedbackOf, type Catalogue, type End } from "./model";

/** A diagram with its subsystems opened: blocks by their path, signals from block to block, through every border. */
export interface Opened {
  /** Blocks by path (`inner.motor`), without the subsystems themselves. */
  blocks: Map<string, Block>;
  /** Subsystems by path, the outer ones first. */
  frames: Map<string, SystemDocument>;
  /** Each by the input that it feeds; `back` closes a loop. */
  wires: { id: string; from: End; to: End; back: boolean }[];
  outputs: { name: string; from: End }[];
}

interface Scope {
  path: string;
  document: SystemDocument;
  parent: Scope | null;
  name: string;
}

export function openedOf(document: SystemDocument, catalogue: Catalogue): Opened {
  const found: Opened = { blocks: new Map(), frames: new Map(), wires: [], outputs: [] };
  const scopes: Scope[] = [{ path: "", document, parent: null, name: "" }];
  const inside = new Map<string, Scope>();
  for (const scope of scopes) {
    for (const [name, block] of Object.entries(scope.document.blocks)) {
      const path = scope.path + name;
      if (!block.system) {
        found.blocks.set(path, block);
        continue;
      }
      const inner = { path: `${path}.`, document: block.system, parent: scope, name };
      found.frames.set(path, block.system);
      inside.set(path, inner);
      scopes.push(inner);
    }
  }
  const fed = new Set<string>();
  /** Where a signal really comes from: down into the subsystem that gives it, up out of the one that it enters. */
  const sourceOf = (scope: Scope, text: string): End | undefined => {
    const end = endOf(text, scope.document, catalogue, "outputs");
    const block = scope.document.blocks[end.block];
    if (!block) return undefined;
    const inner = inside.get(scope.path + end.block);
    if (inner) return inner.document.outputs[end.port] === undefined ? undefined : sourceOf(inner, inner.document.outputs[end.port]!);
    if (block.kind === "input" && scope.parent) {
      const outer = connectionsOf(scope.parent.document).find((wire) => {
        const to = endOf(wire.to, scope.parent!.document, catalogue, "inputs");
        return to.block === scope.name && to.port === end.block;
      });
      if (outer) {
        fed.add(scope.path + end.block);
        return sourceOf(scope.parent, outer.from);
      }
    }
    return { block: scope.path + end.block, port: end.port };
  };
  for (const scope of scopes) {
    for (const wire of connectionsOf(scope.document)) {
      const to = endOf(wire.to, scope.document, catalogue, "inputs");
      if (!scope.document.blocks[to.block] || inside.has(scope.path + to.block)) continue;
      const from = sourceOf(scope, wire.from);
      if (from) found.wires.push({ id: `${scope.path}${to.block}.${to.port}`, from, to: { block: scope.path + to.block, port: to.port }, back: false });
    }
  }
  for (const [name, text] of Object.entries(document.outputs)) {
    const from = sourceOf(scopes[0]!, text);
    if (from) found.outputs.push({ name, from });
  }
  // Ports that are fed from outside are crossings of the border, no blocks.
  for (const path of fed) found.blocks.delete(path);
  const feedback = feedbackOf(plain(found));
  for (const wire of found.wires) wire.back = feedback.has(nameOf(wire.to));
  return found;
}

/** The same as a document without subsystems; a path would be read as block and port. */
function plain({ blocks, wires }: Opened): SystemDocument {
  return { blocks: Object.fromEntries([...blocks].map(([path, block]) => [path.replaceAll(".", "/"), block])), connections: wires.map(({ from, to }) => ({ from: nameOf(from), to: nameOf(to) })), outputs: {} };
}

const nameOf = (end: End): string => `${end.block.replaceAll(".", "/")}.${end.port}`;
