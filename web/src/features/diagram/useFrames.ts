import type { Edge, Node } from "@xyflow/react";
import { useEffect, useMemo, useState } from "react";
import type { SystemDocument } from "@/shared/api/types";
import type { BlockData } from "./BlockNode";
import { LINE, OUT } from "./graph";
import { framed, type Laid } from "./layout";
import { backOf, portsOf, type Catalogue } from "./model";
import { openedOf } from "./opened";
import type { SignalEdgeType } from "./SignalEdge";

const NOTHING: { nodes: Node[]; edges: Edge[] } = { nodes: [], edges: [] };

/** The diagram with all subsystems opened: each loop in its frame, laid out as one picture. */
export function useFrames(document: SystemDocument, catalogue: Catalogue, wanted: boolean, selected: readonly string[], wire: string | null, problems: ReadonlyMap<string, string>) {
  const [found, setFound] = useState<{ of: SystemDocument; laid: Laid } | null>(null);
  useEffect(() => {
    if (!wanted) return;
    let current = true;
    void framed(document, catalogue).then((laid) => current && setFound({ of: document, laid }));
    return () => {
      current = false;
    };
  }, [document, catalogue, wanted]);
  const picture = useMemo(() => {
    if (!wanted || found === null) return NOTHING;
    const { laid, of } = found;
    const opened = openedOf(of, catalogue);
    const chosen = new Set(selected);
    const frames = [...opened.frames].map(([path, inner], depth): Node => ({ id: path, type: "frame", position: laid.frames[path]!, data: { name: path, title: inner.name || path.split(".").at(-1)!, width: laid.frames[path]!.width, height: laid.frames[path]!.height }, selected: chosen.has(path), zIndex: depth - 1000, draggable: false }));
    const blocks = [...opened.blocks].map(([path, block]): Node => {
      const data: BlockData = { name: path.split(".").at(-1)!, title: catalogue.get(block.kind)?.title ?? block.kind, block, ...portsOf(block, catalogue), back: backOf(path, opened.wires), problem: problems.get(path) };
      return { id: path, type: "block", position: laid.places[path]!, data, selected: chosen.has(path), draggable: false, ariaLabel: `${path}, ${data.title}` };
    });
    const outputs = opened.outputs.map(({ name }): Node => ({ id: OUT + name, type: "sink", position: laid.places[OUT + name]!, data: { name }, selected: chosen.has(OUT + name), draggable: false }));
    const edge = (id: string, from: { block: string; port: string }, target: string, port: string): SignalEdgeType => ({ id, source: from.block, sourceHandle: from.port, target, targetHandle: port, selected: wire === id, data: { from: `${from.block}.${from.port}`, route: laid.routes[id], below: undefined }, ...LINE });
    const edges = [...opened.wires.map(({ id, from, to }) => edge(id, from, to.block, to.port)), ...opened.outputs.map(({ name, from }) => ({ ...edge(OUT + name, from, OUT + name, "in"), style: { strokeDasharray: "4 3" } }))];
    return { nodes: [...frames, ...blocks, ...outputs], edges };
  }, [wanted, found, catalogue, selected, wire, problems]);
  return { ...picture, ready: found !== null && found.of === document };
}
