import type { ElkExtendedEdge, ElkNode } from "elkjs";
import type { SystemDocument } from "@/shared/api/types";
import { connectionsOf, endOf, feedbackOf, portsOf, type Catalogue } from "./model";
import type { Point } from "./store";

export const SIZE = { width: 148, row: 20, head: 46 };

export function sizeOf(inputs: number, outputs: number, kind: string): { width: number; height: number } {
  if (kind === "sum") return { width: 44, height: 44 };
  return { width: SIZE.width, height: SIZE.head + SIZE.row * Math.max(inputs, outputs, 1) };
}

/**
 * Places the blocks as a textbook would: from left to right, feedback running back below. Feedback has the lowest priority of
 * direction, or ELK would break a loop at a forward edge and put the sum behind the plant. It works beside the page.
 */
export async function laidOut(document: SystemDocument, catalogue: Catalogue): Promise<Record<string, Point>> {
  const { default: ELK } = await import("elkjs/lib/elk-api.js");
  const elk = new ELK({ workerFactory: () => new Worker(new URL("elkjs/lib/elk-worker.min.js", import.meta.url)) });
  const feedback = feedbackOf(document);
  const children: ElkNode[] = Object.entries(document.blocks).map(([name, block]) => {
    const ports = portsOf(block, catalogue);
    const back = new Set(connectionsOf(document).filter((wire) => feedback.has(wire.to)).map((wire) => endOf(wire.to, document, catalogue, "inputs")).filter((end) => end.block === name).map((end) => end.port));
    return {
      id: name,
      ...sizeOf(ports.inputs.length, ports.outputs.length, block.kind),
      ports: [
        ...ports.inputs.map((port) => ({ id: `${name}.in.${port}`, width: 1, height: 1, layoutOptions: { "elk.port.side": block.kind === "sum" && back.has(port) ? "SOUTH" : "WEST" } })),
        ...ports.outputs.map((port) => ({ id: `${name}.out.${port}`, width: 1, height: 1, layoutOptions: { "elk.port.side": "EAST" } })),
      ],
      layoutOptions: { "elk.portConstraints": "FIXED_SIDE" },
    };
  });
  const outputs: ElkNode[] = Object.keys(document.outputs).map((name) => ({ id: `out:${name}`, width: 110, height: 28, ports: [{ id: `out:${name}.in`, width: 1, height: 1, layoutOptions: { "elk.port.side": "WEST" } }], layoutOptions: { "elk.portConstraints": "FIXED_SIDE" } }));
  const known = (end: { block: string; port: string }, side: "inputs" | "outputs") => {
    const block = document.blocks[end.block];
    return block !== undefined && portsOf(block, catalogue)[side].includes(end.port);
  };
  const edges: ElkExtendedEdge[] = [];
  for (const wire of connectionsOf(document)) {
    const from = endOf(wire.from, document, catalogue, "outputs");
    const to = endOf(wire.to, document, catalogue, "inputs");
    if (!known(from, "outputs") || !known(to, "inputs")) continue;
    const priority = feedback.has(wire.to) ? "0" : "100";
    edges.push({ id: `${wire.from}>${wire.to}`, sources: [`${from.block}.out.${from.port}`], targets: [`${to.block}.in.${to.port}`], layoutOptions: { "elk.layered.priority.direction": priority, "elk.layered.priority.straightness": priority } });
  }
  for (const [name, text] of Object.entries(document.outputs)) {
    const from = endOf(text, document, catalogue, "outputs");
    if (known(from, "outputs")) edges.push({ id: `${text}>out:${name}`, sources: [`${from.block}.out.${from.port}`], targets: [`out:${name}.in`] });
  }
  try {
    const found = await elk.layout({
      id: "root",
      children: [...children, ...outputs],
      edges,
      layoutOptions: {
        "elk.algorithm": "layered",
        "elk.direction": "RIGHT",
        "elk.edgeRouting": "ORTHOGONAL",
        "elk.layered.spacing.nodeNodeBetweenLayers": "56",
        "elk.spacing.nodeNode": "34",
        "elk.layered.feedbackEdges": "true",
        "elk.layered.nodePlacement.strategy": "NETWORK_SIMPLEX",
      },
    });
    return Object.fromEntries((found.children ?? []).map((node) => [node.id, { x: node.x ?? 0, y: node.y ?? 0 }]));
  } finally {
    elk.terminateWorker();
  }
}
