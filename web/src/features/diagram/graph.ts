import { MarkerType, type Edge, type Node } from "@xyflow/react";
import { useMemo, useRef } from "react";
import { useTranslation } from "react-i18next";
import type { SystemDocument } from "@/shared/api/types";
import type { BlockData } from "./BlockNode";
import { SINK, sizeOf } from "./layout";
import { backOf, connectionsOf, endOf, feedbackOf, portsOf, type Catalogue } from "./model";
import type { SignalEdgeType } from "./SignalEdge";
import type { Point, Route } from "./store";
import { telling } from "./telling";

/** Nodes of outputs are called so that no block can be. */
export const OUT = "out:";
export const LINE = { type: "signal", markerEnd: { type: MarkerType.ArrowClosed, width: 14, height: 14 } } as const;
const DASHED = { strokeDasharray: "4 3" };

interface Picture {
  document: SystemDocument;
  catalogue: Catalogue;
  places: Record<string, Point> | undefined;
  problems: ReadonlyMap<string, string>;
  warnings: ReadonlyMap<string, string>;
  selected: readonly string[];
}

/**
 * The nodes of a diagram. A node that says what it said before is the same object: of three hundred blocks, one that is selected
 * or gets a value costs the drawing of one.
 */
export function useNodes({ document, catalogue, places, problems, warnings, selected }: Picture): Node[] {
  const { t } = useTranslation();
  const before = useRef(new Map<string, Node>());
  const wires = useWires(document, catalogue);
  return useMemo(() => {
    const chosen = new Set(selected);
    const kept = (node: Node): Node => {
      const had = before.current.get(node.id);
      if (!had) return node;
      const data = alike(had.data, node.data) ? had.data : node.data;
      return data === had.data && had.selected === node.selected && had.position.x === node.position.x && had.position.y === node.position.y && had.ariaLabel === node.ariaLabel ? had : { ...node, data };
    };
    const blocks = Object.entries(document.blocks).map(([name, block], i) => {
      const ports = portsOf(block, catalogue);
      const entry = catalogue.get(block.kind);
      const data: BlockData = { name, title: entry?.title ?? block.kind, told: telling(block, (entry?.parameters ?? []).map((parameter) => parameter.name)), block, ...ports, back: backOf(name, wires), problem: problems.get(name), warning: warnings.get(name) };
      return kept({ id: name, type: "block", position: places?.[name] ?? { x: 60 + 40 * (i % 8), y: 60 + 40 * i }, data, selected: chosen.has(name), ariaLabel: `${name}, ${data.title}`, ...sized(sizeOf(ports, block.kind)) });
    });
    const outputs = Object.keys(document.outputs).map((name, i) =>
      kept({ id: OUT + name, type: "sink", position: places?.[OUT + name] ?? { x: 700, y: 60 + 50 * i }, data: { name }, selected: chosen.has(OUT + name), ariaLabel: t("diagram.outputNode", { name }), ...sized(SINK) }),
    );
    const nodes = [...blocks, ...outputs];
    before.current = new Map(nodes.map((node) => [node.id, node]));
    return nodes;
  }, [document, catalogue, places, problems, warnings, selected, wires, t]);
}

/** The connections of a diagram as edges: on their routes where the layout has drawn them. */
export function useEdges({ document, catalogue, places, routes, wire }: Pick<Picture, "document" | "catalogue" | "places"> & { routes: Record<string, Route> | undefined; wire: string | null }): Edge[] {
  const wires = useWires(document, catalogue);
  return useMemo(() => {
    const bottoms = [
      ...Object.entries(document.blocks).flatMap(([name, block]) => (places?.[name] ? [{ x: places[name].x, y: places[name].y + sizeOf(portsOf(block, catalogue), block.kind).height }] : [])),
      ...Object.keys(document.outputs).flatMap((name) => (places?.[OUT + name] ? [{ x: places[OUT + name]!.x, y: places[OUT + name]!.y + SINK.height }] : [])),
    ];
    let lanes = 0;
    const edges = wires.map(({ id, from, to, back, label, signal }): SignalEdgeType => {
      const [left, right] = [places?.[to.block]?.x, places?.[from.block]?.x];
      // Loops inside of loops run beside each other, the outer one lower.
      const below = back && left !== undefined && right !== undefined && right >= left ? Math.max(...bottoms.filter((b) => b.x >= left && b.x <= right).map((b) => b.y)) + 22 + 12 * lanes++ : undefined;
      return { id, source: from.block, sourceHandle: from.port, target: to.block, targetHandle: to.port, selected: wire === id, data: { from: signal, route: routes?.[id], below }, ariaLabel: label, ...LINE };
    });
    const outs = Object.entries(document.outputs).map(([name, text]): SignalEdgeType => {
      const from = endOf(text, document, catalogue, "outputs");
      const id = OUT + name;
      return { id, source: from.block, sourceHandle: from.port, target: id, targetHandle: "in", selected: wire === id, data: { from: text, route: routes?.[id], below: undefined }, ariaLabel: `${text} → ${name}`, style: DASHED, ...LINE };
    });
    return [...edges, ...outs].filter((edge) => document.blocks[edge.source]);
  }, [document, catalogue, wires, places, routes, wire]);
}

function useWires(document: SystemDocument, catalogue: Catalogue) {
  return useMemo(() => {
    const feedback = feedbackOf(document);
    return connectionsOf(document).map((wire) => {
      const to = endOf(wire.to, document, catalogue, "inputs");
      return { id: `${to.block}.${to.port}`, from: endOf(wire.from, document, catalogue, "outputs"), to, back: feedback.has(wire.to), signal: wire.from, label: `${wire.from} → ${wire.to}` };
    });
  }, [document, catalogue]);
}

/** Known sizes spare React Flow the measuring before the first picture. */
const sized = ({ width, height }: { width: number; height: number }) => ({ initialWidth: width, initialHeight: height });

function alike(a: Record<string, unknown>, b: Record<string, unknown>): boolean {
  return Object.keys(b).every((key) => {
    const [x, y] = [a[key], b[key]];
    return x === y || (Array.isArray(x) && Array.isArray(y) && x.length === y.length && x.every((item, i) => item === y[i]));
  });
}
