import type { ElkExtendedEdge, ElkNode } from "elkjs";
import type { SystemDocument } from "@/shared/api/types";
import { backOf, connectionsOf, endOf, feedbackOf, portsOf, type Catalogue, type Ports } from "./model";
import { openedOf, type Opened } from "./opened";
import type { Point, Route } from "./store";

export const SIZE = { width: 132, row: 20, head: 46 };
export const SINK = { width: 104, height: 28 };
const SUM = 44;

export function sizeOf(ports: Ports, kind: string): { width: number; height: number } {
  if (kind === "sum") return { width: SUM, height: SUM };
  return { width: SIZE.width, height: SIZE.head + SIZE.row * Math.max(ports.inputs.length, ports.outputs.length, 1) };
}

/** Where on its block each port is; what a loop brings back to a sum comes from below. */
export function portPlaces(ports: Ports, kind: string, back: readonly string[]): { inputs: Point[]; outputs: Point[] } {
  const size = sizeOf(ports, kind);
  if (kind === "sum") {
    const ahead = ports.inputs.filter((port) => !back.includes(port));
    const behind = ports.inputs.filter((port) => back.includes(port));
    const share = (list: string[], port: string) => (SUM * (list.indexOf(port) + 1)) / (list.length + 1);
    return { inputs: ports.inputs.map((port) => (back.includes(port) ? { x: share(behind, port), y: SUM } : { x: 0, y: share(ahead, port) })), outputs: [{ x: SUM, y: SUM / 2 }] };
  }
  const row = (i: number) => size.height - SIZE.row * Math.max(ports.inputs.length, ports.outputs.length, 1) + SIZE.row * i + 6;
  return { inputs: ports.inputs.map((_, i) => ({ x: 0, y: row(i) })), outputs: ports.outputs.map((_, i) => ({ x: size.width, y: row(i) })) };
}

export interface Laid {
  places: Record<string, Point>;
  routes: Record<string, Route>;
  /** Subsystems that are drawn opened. */
  frames: Record<string, Point & { width: number; height: number }>;
}

const OPTIONS = {
  "elk.algorithm": "layered",
  "elk.direction": "RIGHT",
  "elk.edgeRouting": "ORTHOGONAL",
  "elk.hierarchyHandling": "INCLUDE_CHILDREN",
  "elk.json.edgeCoords": "ROOT",
  "elk.json.shapeCoords": "ROOT",
  "elk.layered.spacing.nodeNodeBetweenLayers": "44",
  "elk.layered.spacing.edgeNodeBetweenLayers": "18",
  "elk.layered.spacing.edgeEdgeBetweenLayers": "12",
  "elk.spacing.nodeNode": "34",
  "elk.spacing.edgeNode": "20",
  "elk.spacing.edgeEdge": "12",
  "elk.layered.nodePlacement.strategy": "NETWORK_SIMPLEX",
};

/**
 * Places the blocks as a textbook would: from left to right, straight where it can be, feedback running back. Computed beside the
 * page, in a worker.
 */
export async function laidOut(document: SystemDocument, catalogue: Catalogue): Promise<Laid> {
  const feedback = feedbackOf(document);
  const wires = connectionsOf(document).map((wire) => {
    const to = endOf(wire.to, document, catalogue, "inputs");
    return { id: `${to.block}.${to.port}`, from: endOf(wire.from, document, catalogue, "outputs"), to, back: feedback.has(wire.to) };
  });
  const outputs = Object.entries(document.outputs).map(([name, text]) => ({ name, from: endOf(text, document, catalogue, "outputs") }));
  return drawn({ blocks: new Map(Object.entries(document.blocks)), frames: new Map(), wires, outputs }, catalogue);
}

/** The same with every subsystem opened: each loop stands in a frame, inside the frame of the loop around it. */
export async function framed(document: SystemDocument, catalogue: Catalogue): Promise<Laid> {
  return drawn(openedOf(document, catalogue), catalogue);
}

async function drawn(opened: Opened, catalogue: Catalogue): Promise<Laid> {
  const { default: ELK } = await import("elkjs/lib/elk-api.js");
  const elk = new ELK({ workerFactory: () => new Worker(new URL("elkjs/lib/elk-worker.min.js", import.meta.url)) });
  try {
    return laidBy(await elk.layout(elkOf(opened, catalogue)), opened);
  } finally {
    elk.terminateWorker();
  }
}

/** What ELK is asked: blocks with their ports where they are drawn, frames around them, signals from port to port. */
export function elkOf(net: Opened, catalogue: Catalogue): ElkNode {
  const root: ElkNode = { id: "root", children: [], edges: [], layoutOptions: OPTIONS };
  const parents = new Map<string, ElkNode>();
  const parentOf = (path: string): ElkNode => parents.get(path.slice(0, path.lastIndexOf("."))) ?? root;
  for (const path of net.frames.keys()) {
    const node: ElkNode = { id: path, children: [], layoutOptions: { "elk.padding": "[top=30,left=20,bottom=20,right=20]", ...OPTIONS } };
    parentOf(path).children!.push(node);
    parents.set(path, node);
  }
  const port = (id: string, at: Point, side: string) => ({ id, x: at.x, y: at.y, width: 0, height: 0, layoutOptions: { "elk.port.side": side } });
  const known = new Set<string>();
  for (const [path, block] of net.blocks) {
    const ports = portsOf(block, catalogue);
    const back = backOf(path, net.wires);
    const at = portPlaces(ports, block.kind, back);
    for (const name of ports.inputs) known.add(`${path}.in.${name}`);
    for (const name of ports.outputs) known.add(`${path}.out.${name}`);
    parentOf(path).children!.push({
      id: path,
      ...sizeOf(ports, block.kind),
      ports: [...ports.inputs.map((name, i) => port(`${path}.in.${name}`, at.inputs[i]!, block.kind === "sum" && back.includes(name) ? "SOUTH" : "WEST")), ...ports.outputs.map((name, i) => port(`${path}.out.${name}`, at.outputs[i]!, "EAST"))],
      layoutOptions: { "elk.portConstraints": "FIXED_POS" },
    });
  }
  for (const { name } of net.outputs) root.children!.push({ id: `out:${name}`, ...SINK, ports: [port(`out:${name}.in`, { x: 0, y: SINK.height / 2 }, "WEST")], layoutOptions: { "elk.portConstraints": "FIXED_POS" } });
  const edges: ElkExtendedEdge[] = root.edges!;
  for (const wire of net.wires) {
    const [source, target] = [`${wire.from.block}.out.${wire.from.port}`, `${wire.to.block}.in.${wire.to.port}`];
    if (!known.has(source) || !known.has(target)) continue;
    // What leads back is handed over turned round: left to itself, ELK may break a loop at a forward edge and put the sum behind the plant.
    edges.push({ id: wire.id, sources: [wire.back ? target : source], targets: [wire.back ? source : target], layoutOptions: { "elk.layered.priority.straightness": wire.back ? "0" : "10" } });
  }
  for (const { name, from } of net.outputs) {
    const source = `${from.block}.out.${from.port}`;
    if (known.has(source)) edges.push({ id: `out:${name}`, sources: [source], targets: [`out:${name}.in`], layoutOptions: { "elk.layered.priority.straightness": "1" } });
  }
  return root;
}

export function laidBy(root: ElkNode, net: Opened): Laid {
  const back = new Set(net.wires.flatMap((wire) => (wire.back ? [wire.id] : [])));
  const laid: Laid = { places: {}, routes: {}, frames: {} };
  const walk = (node: ElkNode): void => {
    for (const child of node.children ?? []) {
      const at = { x: child.x ?? 0, y: child.y ?? 0 };
      if (child.children) laid.frames[child.id] = { ...at, width: child.width ?? 0, height: child.height ?? 0 };
      else laid.places[child.id] = at;
      walk(child);
    }
  };
  walk(root);
  for (const edge of root.edges ?? []) {
    const points = (edge.sections ?? []).flatMap((section) => [section.startPoint, ...(section.bendPoints ?? []), section.endPoint]).map(({ x, y }) => ({ x, y }));
    if (points.length > 1) laid.routes[edge.id] = back.has(edge.id) ? points.reverse() : points;
  }
  return laid;
}
