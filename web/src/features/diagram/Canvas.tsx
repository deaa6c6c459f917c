import { useComputedColorScheme } from "@mantine/core";
import { applyNodeChanges, Background, Controls, ReactFlow, useReactFlow, useStore, type Edge, type Node, type NodeChange, type ReactFlowProps } from "@xyflow/react";
import { memo, useEffect, useMemo, useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import { BlockNode, FrameNode, OutputNode } from "./BlockNode";
import classes from "./DiagramPage.module.css";
import { OUT } from "./graph";
import type { End } from "./model";
import { DRAGGED } from "./Palette";
import { SignalEdge } from "./SignalEdge";
import type { Point } from "./store";

const EDGES = { signal: SignalEdge };
const NODES = { block: BlockNode, sink: OutputNode, frame: FrameNode };
/** From here on only what is seen is drawn: below, it costs less to keep the others than to bring them back. */
const MANY = 500;
/** Below this magnification nobody reads what stands on a block: neither texts nor ports nor the grid are painted. */
const FAR = 0.4;

interface Props {
  nodes: Node[];
  edges: Edge[];
  /** Nothing is moved or connected where subsystems stand open. */
  fixed: boolean;
  onSelect(change: (before: readonly string[]) => string[]): void;
  onWire(id: string | null): void;
  onMove(places: Record<string, Point>): void;
  onConnect(from: End, to: End): void;
  onOpen(name: string): void;
  /** A block was dropped, or a connection led to where no block is yet. */
  onDrop(kind: string, at: Point): void;
  onWanted(at: Point, from: End | null): void;
}

/** The picture of a diagram. What moves while it is dragged is known here only: nothing else of the page is drawn again for it. */
export const Canvas = memo(function Canvas({ nodes: built, edges, fixed, onSelect, onWire, onMove, onConnect, onOpen, onDrop, onWanted }: Props) {
  const { t } = useTranslation();
  const dark = useComputedColorScheme("light") === "dark";
  const flow = useReactFlow();
  const [nodes, setNodes] = useState<Node[]>(built);
  const last = useRef(built);
  const holder = useRef<HTMLDivElement>(null);
  // What is measured and dragged is React Flow's; the document's part of each node is renewed around it.
  useEffect(() => {
    const was = new Map(last.current.map((node) => [node.id, node]));
    last.current = built;
    setNodes((before) => {
      const had = new Map(before.map((node) => [node.id, node]));
      return built.map((node) => {
        const own = had.get(node.id);
        return own && was.get(node.id) === node ? own : own?.measured ? { ...node, measured: own.measured } : node;
      });
    });
  }, [built]);
  const labels = useMemo(() => ({ "node.a11yDescription.default": t("diagram.nodeHelp"), "edge.a11yDescription.default": t("diagram.edgeHelp") }), [t]);

  const far = useStore((state) => state.transform[2] < FAR);
  const act = useRef<Props>(null!);
  act.current = { nodes: built, edges, fixed, onSelect, onWire, onMove, onConnect, onOpen, onDrop, onWanted };
  const on = useHandlers(act, setNodes, holder);
  return (
    <div
      ref={holder}
      className={classes.canvas}
      data-far={far}
      data-fixed={fixed}
      onDragOver={(event) => {
        if (!fixed && event.dataTransfer.types.includes(DRAGGED)) event.preventDefault();
      }}
      onDrop={(event) => {
        const kind = event.dataTransfer.getData(DRAGGED);
        if (!kind) return;
        event.preventDefault();
        const at = flow.screenToFlowPosition({ x: event.clientX, y: event.clientY });
        onDrop(kind, { x: at.x - 66, y: at.y - 25 });
      }}
      onDoubleClick={(event) => {
        if (!fixed && (event.target as Element).classList.contains("react-flow__pane")) onWanted(flow.screenToFlowPosition({ x: event.clientX, y: event.clientY }), null);
      }}
    >
      <ReactFlow
        nodes={nodes}
        edges={edges}
        nodeTypes={NODES}
        edgeTypes={EDGES}
        colorMode={dark ? "dark" : "light"}
        {...on}
        nodesDraggable={!fixed}
        nodesConnectable={!fixed}
        deleteKeyCode={null}
        zoomOnDoubleClick={false}
        connectionRadius={28}
        minZoom={0.1}
        snapToGrid
        snapGrid={SNAP}
        onlyRenderVisibleElements={built.length > MANY}
        ariaLabelConfig={labels}
      >
        {!far && <Background gap={20} />}
        <Controls showInteractive={false} />
      </ReactFlow>
    </div>
  );
});

/** What the picture is told. The same functions for ever: new ones would make every block be drawn again for each movement of one. */
function useHandlers(act: { current: Props }, setNodes: (update: (before: Node[]) => Node[]) => void, holder: { current: HTMLElement | null }) {
  const flow = useReactFlow();
  return useMemo(
    () =>
      ({
        onNodesChange(changes: NodeChange[]) {
          setNodes((before) => applyNodeChanges(changes, before));
          const { nodes, onSelect, onWire, onMove } = act.current;
          const picked = changes.filter((c) => c.type === "select");
          if (picked.length > 0) {
            onSelect((before) => {
              const next = new Set(before);
              for (const c of picked) if (c.selected) next.add(c.id); else next.delete(c.id);
              return [...next];
            });
            if (picked.some((c) => c.selected)) onWire(null);
          }
          // Arrow keys move blocks, too; each press is a gesture of its own.
          const moved = changes.flatMap((c) => (c.type === "position" && c.dragging === false && c.position ? [[c.id, c.position] as const] : []));
          if (moved.length > 0) onMove({ ...Object.fromEntries(nodes.map((node) => [node.id, node.position])), ...Object.fromEntries(moved) });
        },
        onEdgeClick(_, edge) {
          act.current.onSelect(() => []);
          act.current.onWire(edge.id);
        },
        onPaneClick() {
          act.current.onWire(null);
          act.current.onSelect(() => []);
        },
        onNodeDoubleClick: (_, node) => act.current.onOpen(node.id),
        onConnect({ source, sourceHandle, target, targetHandle }) {
          if (!target.startsWith(OUT)) act.current.onConnect({ block: source, port: sourceHandle ?? "out" }, { block: target, port: targetHandle ?? "in" });
        },
        onConnectEnd(event, { isValid, fromHandle, to }) {
          const over = (event.target as Element | null)?.classList.contains("react-flow__pane");
          if (!isValid && over && to && fromHandle?.type === "source" && fromHandle.id) act.current.onWanted(flow.screenToFlowPosition(pointOf(event)), { block: fromHandle.nodeId, port: fromHandle.id });
        },
        onMoveStart: () => holder.current?.setAttribute("data-moving", ""),
        onMoveEnd: () => holder.current?.removeAttribute("data-moving"),
      }) satisfies ReactFlowProps,
    [act, setNodes, holder, flow],
  );
}

const SNAP: [number, number] = [10, 10];

function pointOf(event: MouseEvent | TouchEvent): Point {
  const at = "changedTouches" in event ? event.changedTouches[0]! : event;
  return { x: at.clientX, y: at.clientY };
}
