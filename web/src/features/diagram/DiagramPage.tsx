import { Alert, Anchor, Breadcrumbs, Button, Group, Text, useComputedColorScheme } from "@mantine/core";
import { useQuery, useQueryClient } from "@tanstack/react-query";
import { applyNodeChanges, Background, Controls, MarkerType, ReactFlow, ReactFlowProvider, useReactFlow, type Edge, type Node } from "@xyflow/react";
import "@xyflow/react/dist/style.css";
import { useCallback, useEffect, useMemo, useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import { useBlocker, useParams, useSearchParams } from "react-router";
import { elementsQuery } from "@/shared/api/catalogue";
import { isProblem } from "@/shared/api/problem";
import { saveSystem, systemQuery } from "@/shared/api/systems";
import type { ElementEntry, SystemDocument } from "@/shared/api/types";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { BlockNode, OutputNode, type BlockData } from "./BlockNode";
import { ConflictDialog, type Conflict } from "./ConflictDialog";
import classes from "./DiagramPage.module.css";
import { FeedbackEdge } from "./FeedbackEdge";
import { Inspector } from "./Inspector";
import { laidOut, sizeOf } from "./layout";
import { blockOf, connect, connectionsOf, disconnect, endOf, feedbackOf, freeName, partOf, pasted, portsOf, removeBlocks, scoped, withScoped, type Catalogue } from "./model";
import { DRAGGED, Palette } from "./Palette";
import { SignalPlot } from "./SignalPlot";
import { keepPlaces, keptPlaces, useEditor, type Point } from "./store";
import { useCheck } from "./useCheck";

const EDGES = { feedback: FeedbackEdge };
const NODES = { block: BlockNode, sink: OutputNode };
const OUT = "out:";

export function DiagramPage() {
  const { id = "" } = useParams();
  const system = useQuery(systemQuery(id)).data!;
  const elements = useQuery(elementsQuery);
  const [ready, setReady] = useState("");
  const start = useEditor((s) => s.start);
  useEffect(() => {
    start(system.document, system.etag, keptPlaces(id));
    setReady(id);
    // What the service has later is no reason to throw away what is being edited: saving will tell.
  }, [id, start]);
  if (elements.isError) return <ProblemAlert error={elements.error} m="md" onRetry={() => void elements.refetch()} />;
  if (!elements.data || ready !== id) return null;
  return (
    <ReactFlowProvider>
      <Editor id={id} catalogue={elements.data} />
    </ReactFlowProvider>
  );
}

function Editor({ id, catalogue }: { id: string; catalogue: Catalogue }) {
  const { t } = useTranslation();
  const dark = useComputedColorScheme("light") === "dark";
  const queries = useQueryClient();
  const flow = useReactFlow();
  const { document: root, places, edit, place, undo, redo, past, future, base, etag, saved, start } = useEditor();
  const [query, setQuery] = useSearchParams();
  const scope = useMemo(() => (query.get("in") ?? "").split(".").filter(Boolean), [query]);
  const document = scoped(root, scope) ?? root;
  const scopeKey = scope.join(".");
  const own = places[scopeKey];
  const [selected, setSelected] = useState<string[]>([]);
  const [wire, setWire] = useState<string | null>(null);
  const [conflict, setConflict] = useState<Conflict | null>(null);
  const [saving, setSaving] = useState(false);
  const [failure, setFailure] = useState<unknown>(null);
  const check = useCheck(root);
  const pointer = `/system${scope.map((name) => `/blocks/${name}/system`).join("")}`;
  const dirty = root !== base && JSON.stringify(root) !== JSON.stringify(base);

  const change = useCallback((next: SystemDocument, more?: Record<string, Point>) => edit({ document: withScoped(useEditor.getState().document, scope, () => next), ...(more ? { places: { ...places, [scopeKey]: { ...own, ...more } } } : {}) }), [edit, scope, places, scopeKey, own]);

  const arrange = useCallback(async () => {
    const found = await laidOut(document, catalogue);
    place({ ...useEditor.getState().places, [scopeKey]: found });
    requestAnimationFrame(() => void flow.fitView({ padding: 0.12, maxZoom: 1.2 }));
  }, [document, catalogue, scopeKey, place, flow]);
  useEffect(() => {
    // A diagram that nobody has arranged is laid out once; blocks that come later are put where they were dropped.
    if (own === undefined) void arrange();
    else requestAnimationFrame(() => void flow.fitView({ padding: 0.12, maxZoom: 1.2 }));
  }, [scopeKey]);
  useEffect(() => keepPlaces(id, places), [id, places]);

  const feedback = useMemo(() => feedbackOf(document), [document]);
  const built = useMemo<Node[]>(() => {
    const messages = new Map<string, string>();
    for (const warning of check.warnings) {
      const found = /\/blocks\/([^/]+)/.exec(warning.pointer.startsWith(pointer) ? warning.pointer.slice(pointer.length) : "");
      if (found) messages.set(found[1]!, warning.detail);
    }
    const blocks = Object.entries(document.blocks).map(([name, block], i): Node => {
      const ports = portsOf(block, catalogue);
      const back = connectionsOf(document).filter((w) => feedback.has(w.to)).map((w) => endOf(w.to, document, catalogue, "inputs")).filter((end) => end.block === name).map((end) => end.port);
      const data: BlockData = { name, title: catalogue.get(block.kind)?.title ?? block.kind, block, inputs: ports.inputs, outputs: ports.outputs, back, problem: check.problem?.at(`${pointer}/blocks/${name}`), warning: messages.get(name) };
      return { id: name, type: "block", position: own?.[name] ?? { x: 60 + 40 * (i % 8), y: 60 + 40 * i }, data, selected: selected.includes(name), ariaLabel: `${name}, ${data.title}` };
    });
    const outputs = Object.keys(document.outputs).map((name, i): Node => ({ id: OUT + name, type: "sink", position: own?.[OUT + name] ?? { x: 700, y: 60 + 50 * i }, data: { name }, selected: selected.includes(OUT + name), ariaLabel: t("diagram.outputNode", { name }) }));
    return [...blocks, ...outputs];
  }, [document, own, catalogue, check.problem, check.warnings, pointer, selected, feedback, t]);
  const [nodes, setNodes] = useState<Node[]>(built);
  // What is measured and dragged is React Flow's; the document's part of each node is renewed around it.
  useEffect(() => setNodes((before) => {
    const had = new Map(before.map((node) => [node.id, node]));
    return built.map((node) => ({ ...had.get(node.id), ...node }));
  }), [built]);

  const edges = useMemo<Edge[]>(() => {
    const line = { type: "smoothstep", markerEnd: { type: MarkerType.ArrowClosed, width: 14, height: 14 } };
    const bottoms = Object.entries(document.blocks).flatMap(([name, block]) => {
      const at = own?.[name];
      const ports = portsOf(block, catalogue);
      return at ? [{ x: at.x, y: at.y + sizeOf(ports.inputs.length, ports.outputs.length, block.kind).height }] : [];
    });
    for (const name of Object.keys(document.outputs)) {
      const at = own?.[OUT + name];
      if (at) bottoms.push({ x: at.x, y: at.y + 28 });
    }
    let lanes = 0;
    const wires = connectionsOf(document).map((w): Edge => {
      const from = endOf(w.from, document, catalogue, "outputs");
      const to = endOf(w.to, document, catalogue, "inputs");
      const key = `${to.block}.${to.port}`;
      const [left, right] = [own?.[to.block]?.x, own?.[from.block]?.x];
      if (feedback.has(w.to) && left !== undefined && right !== undefined && right >= left) {
        // Loops inside of loops run beside each other, the outer one lower.
        const below = Math.max(...bottoms.filter((b) => b.x >= left && b.x <= right).map((b) => b.y)) + 22 + 12 * lanes++;
        return { id: key, source: from.block, sourceHandle: from.port, target: to.block, targetHandle: to.port, selected: wire === key, data: { from: w.from, below }, ariaLabel: `${w.from} → ${w.to}`, ...line, type: "feedback" };
      }
      return { id: key, source: from.block, sourceHandle: from.port, target: to.block, targetHandle: to.port, selected: wire === key, data: { from: w.from }, ariaLabel: `${w.from} → ${w.to}`, ...line };
    });
    const outs = Object.entries(document.outputs).map(([name, text]): Edge => {
      const from = endOf(text, document, catalogue, "outputs");
      return { id: OUT + name, source: from.block, sourceHandle: from.port, target: OUT + name, targetHandle: "in", selected: wire === OUT + name, data: { from: text }, ariaLabel: `${text} → ${name}`, style: { strokeDasharray: "4 3" }, ...line };
    });
    return [...wires, ...outs].filter((edge) => document.blocks[edge.source]);
  }, [document, catalogue, wire, own, feedback]);

  const add = useCallback(
    (entry: ElementEntry, at?: Point) => {
      const canvas = window.document.querySelector(".react-flow")!.getBoundingClientRect();
      const where = at ?? flow.screenToFlowPosition({ x: canvas.x + canvas.width / 2, y: canvas.y + canvas.height / 2 });
      const name = freeName(entry.kind, Object.keys(document.blocks));
      const taken = new Set(Object.values(own ?? {}).map((p) => `${p.x},${p.y}`));
      const point = { x: Math.round(where.x / 10) * 10, y: Math.round(where.y / 10) * 10 };
      while (taken.has(`${point.x},${point.y}`)) Object.assign(point, { x: point.x + 30, y: point.y + 30 });
      change({ ...document, blocks: { ...document.blocks, [name]: blockOf(entry) } }, { [name]: point });
      setSelected([name]);
      setWire(null);
    },
    [document, own, change, flow],
  );

  const remove = useCallback(() => {
    if (wire?.startsWith(OUT)) change({ ...document, outputs: Object.fromEntries(Object.entries(document.outputs).filter(([name]) => OUT + name !== wire)) });
    else if (wire) {
      const [block = "", port = ""] = wire.split(".");
      change(disconnect(document, catalogue, { block, port }));
    } else if (selected.length > 0) {
      const blocks = new Set(selected.filter((name) => !name.startsWith(OUT)));
      const outputs = new Set(selected.filter((name) => name.startsWith(OUT)).map((name) => name.slice(OUT.length)));
      const next = removeBlocks(document, blocks);
      change({ ...next, outputs: Object.fromEntries(Object.entries(next.outputs).filter(([name]) => !outputs.has(name))) });
    }
    setWire(null);
    setSelected([]);
  }, [wire, selected, document, catalogue, change]);

  const finishSave = async (next: SystemDocument, tag: string) => {
    setSaving(true);
    setFailure(null);
    try {
      const reply = await saveSystem(id, next, tag);
      if (next !== useEditor.getState().document) edit({ document: next });
      saved(next, reply.etag);
      setConflict(null);
      void queries.invalidateQueries({ queryKey: ["system", id] });
    } catch (error) {
      if (!isProblem(error, 412)) setFailure(error);
      else {
        const found = await queries.fetchQuery({ ...systemQuery(id), staleTime: 0 });
        setConflict({ base: useEditor.getState().base, mine: next, theirs: found.document, etag: found.etag });
      }
    } finally {
      setSaving(false);
    }
  };

  const clipboard = useRef<SystemDocument | null>(null);
  const onKey = (event: KeyboardEvent) => {
    const inField = (event.target as HTMLElement).closest("input, textarea, select, [role=dialog]") !== null;
    const command = event.ctrlKey || event.metaKey;
    const key = event.key.toLowerCase();
    const actions: Record<string, () => void> = {
      s: () => void (dirty && finishSave(root, etag)),
      ...(inField
        ? {}
        : {
            z: event.shiftKey ? redo : undo,
            y: redo,
            c: () => (clipboard.current = partOf(document, new Set(selected))),
            v: () => {
              if (!clipboard.current) return;
              const { document: next, names } = pasted(document, clipboard.current);
              const moved = Object.fromEntries(names.map((name, i) => [name, { x: (own?.[selected[i] ?? ""]?.x ?? 80) + 40, y: (own?.[selected[i] ?? ""]?.y ?? 80) + 60 }]));
              change(next, moved);
              setSelected(names);
            },
            a: () => setSelected(nodes.map((node) => node.id)),
          }),
    };
    if (command && actions[key]) {
      event.preventDefault();
      actions[key]();
    } else if (!inField && !command && (event.key === "Delete" || event.key === "Backspace")) {
      event.preventDefault();
      remove();
    }
  };
  const keyHandler = useRef(onKey);
  keyHandler.current = onKey;
  useEffect(() => {
    const listen = (event: KeyboardEvent) => keyHandler.current(event);
    window.addEventListener("keydown", listen);
    return () => window.removeEventListener("keydown", listen);
  }, []);

  const blocker = useBlocker(({ currentLocation, nextLocation }) => dirty && currentLocation.pathname !== nextLocation.pathname);
  useEffect(() => {
    if (!dirty) return;
    const warn = (event: BeforeUnloadEvent) => event.preventDefault();
    window.addEventListener("beforeunload", warn);
    return () => window.removeEventListener("beforeunload", warn);
  }, [dirty]);

  const enter = (name: string) => setQuery({ in: [...scope, name].join(".") });
  const one = selected.length === 1 ? selected[0]! : null;
  const signal = wire && scope.length === 0 ? (edges.find((edge) => edge.id === wire)?.data?.from as string | undefined) : undefined;

  return (
    <div className={classes.page}>
      <aside className={classes.palette} aria-label={t("diagram.palette")}>
        <Palette catalogue={catalogue} onAdd={(entry) => add(entry)} />
      </aside>
      <div className={classes.middle}>
        <Group justify="space-between" px="sm" py={6} className={classes.bar} wrap="nowrap">
          <Breadcrumbs separator="›">
            <Anchor component="button" fz="sm" onClick={() => setQuery({})}>
              {root.name || t("diagram.system")}
            </Anchor>
            {scope.map((name, i) => (
              <Anchor component="button" key={name} fz="sm" onClick={() => setQuery({ in: scope.slice(0, i + 1).join(".") })}>
                {name}
              </Anchor>
            ))}
          </Breadcrumbs>
          <Group gap={6} wrap="nowrap">
            <Text span fz="xs" role="status" data-testid="check" data-pending={check.pending}>
              {!check.complete ? t("diagram.incomplete") : check.problem ? t("diagram.wrong") : check.error ? check.error.message : dirty ? t("diagram.unsaved") : t("diagram.fine")}
            </Text>
            <Button variant="default" onClick={undo} disabled={past.length === 0} aria-keyshortcuts="Control+Z">
              {t("diagram.undo")}
            </Button>
            <Button variant="default" onClick={redo} disabled={future.length === 0} aria-keyshortcuts="Control+Shift+Z">
              {t("diagram.redo")}
            </Button>
            <Button variant="default" onClick={() => void arrange()}>
              {t("diagram.arrange")}
            </Button>
            <Button onClick={() => void finishSave(root, etag)} disabled={!dirty} loading={saving} aria-keyshortcuts="Control+S">
              {t("diagram.save")}
            </Button>
          </Group>
        </Group>
        {check.problem && (
          <Alert color="red" variant="outline" m={6} p="xs" role="alert">
            {check.problem.elsewhere([]).slice(0, 3).join(" · ")}
          </Alert>
        )}
        {failure !== null && <ProblemAlert error={failure} m={6} />}
        <div
          className={classes.canvas}
          onDragOver={(event) => {
            if (event.dataTransfer.types.includes(DRAGGED)) event.preventDefault();
          }}
          onDrop={(event) => {
            const entry = catalogue.get(event.dataTransfer.getData(DRAGGED));
            if (!entry) return;
            event.preventDefault();
            const at = flow.screenToFlowPosition({ x: event.clientX, y: event.clientY });
            add(entry, { x: at.x - 70, y: at.y - 25 });
          }}
        >
          <ReactFlow
            nodes={nodes}
            edges={edges}
            nodeTypes={NODES}
            edgeTypes={EDGES}
            colorMode={dark ? "dark" : "light"}
            onNodesChange={(changes) => {
              setNodes((before) => applyNodeChanges(changes, before));
              const picked = changes.filter((c) => c.type === "select");
              if (picked.length > 0) {
                setSelected((before) => {
                  const next = new Set(before);
                  for (const c of picked) if (c.selected) next.add(c.id); else next.delete(c.id);
                  return [...next];
                });
                if (picked.some((c) => c.selected)) setWire(null);
              }
              // Arrow keys move blocks, too; each press is a gesture of its own.
              const keyed = changes.flatMap((c) => (c.type === "position" && c.dragging === false && c.position ? [[c.id, c.position] as const] : []));
              if (keyed.length > 0) edit({ places: { ...places, [scopeKey]: { ...Object.fromEntries(nodes.map((n) => [n.id, n.position])), ...own, ...Object.fromEntries(keyed) } } });
            }}
            onEdgeClick={(_, edge) => {
              setSelected([]);
              setWire(edge.id);
            }}
            onPaneClick={() => {
              setWire(null);
              setSelected([]);
            }}
            onNodeDoubleClick={(_, node) => document.blocks[node.id]?.system && enter(node.id)}
            onConnect={({ source, sourceHandle, target, targetHandle }) => {
              const from = { block: source, port: sourceHandle ?? "out" };
              if (target.startsWith(OUT)) return;
              change(connect(document, catalogue, from, { block: target, port: targetHandle ?? "in" }));
            }}
            deleteKeyCode={null}
            connectionRadius={28}
            minZoom={0.1}
            snapToGrid
            snapGrid={[10, 10]}
            onlyRenderVisibleElements={nodes.length > 120}
            ariaLabelConfig={{ "node.a11yDescription.default": t("diagram.nodeHelp"), "edge.a11yDescription.default": t("diagram.edgeHelp") }}
          >
            <Background gap={20} />
            <Controls showInteractive={false} />
          </ReactFlow>
        </div>
        {signal && (
          <div className={classes.signal}>
            <SignalPlot document={root} from={signal} />
          </div>
        )}
      </div>
      <aside className={classes.inspector} aria-label={t("diagram.inspector")}>
        <Inspector document={document} catalogue={catalogue} selected={one} problem={check.problem} pointer={pointer} onEdit={change} onSelect={(name) => setSelected(name ? [name] : [])} onEnter={enter} />
      </aside>
      <ConflictDialog
        conflict={conflict}
        onClose={() => setConflict(null)}
        onMerge={(next, found) => void finishSave(next, found.etag)}
        onTakeTheirs={(found) => {
          start(found.theirs, found.etag, places);
          setConflict(null);
        }}
      />
      {blocker.state === "blocked" && (
        <div className={classes.leave} role="alertdialog" aria-label={t("diagram.leave")}>
          <Text fz="sm">{t("diagram.leave")}</Text>
          <Button variant="default" onClick={() => blocker.reset()} autoFocus>
            {t("diagram.stay")}
          </Button>
          <Button color="red" onClick={() => blocker.proceed()}>
            {t("diagram.discard")}
          </Button>
        </div>
      )}
    </div>
  );
}
