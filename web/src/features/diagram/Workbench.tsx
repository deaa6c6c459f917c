import { Alert, Button, Group, Text } from "@mantine/core";
import { useReactFlow } from "@xyflow/react";
import { useCallback, useEffect, useMemo, useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import { useBlocker, useSearchParams } from "react-router";
import { useStore } from "zustand";
import { useShallow } from "zustand/react/shallow";
import type { Block, SystemDocument } from "@/shared/api/types";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { When } from "@/shared/ui/When";
import { Canvas } from "./Canvas";
import { ConflictDialog } from "./ConflictDialog";
import classes from "./DiagramPage.module.css";
import { Faults } from "./Faults";
import { OUT, useEdges, useNodes } from "./graph";
import { dissolved, grouped } from "./group";
import { Inspector } from "./Inspector";
import { laidOut } from "./layout";
import { blockOf, connect, disconnect, freeName, pathsOf, portsOf, removeBlocks, renameBlock, scoped, withOutput, withScoped, type Catalogue, type End } from "./model";
import { Palette } from "./Palette";
import { QuickEntry, type Mode } from "./QuickEntry";
import { SignalPlot } from "./SignalPlot";
import { beside, freePlace } from "./spots";
import { useEditor, type Point } from "./store";
import { Toolbar } from "./Toolbar";
import { useCheck } from "./useCheck";
import { useClipboard } from "./useClipboard";
import { useFrames } from "./useFrames";
import { useKeys } from "./useKeys";
import { useSaving } from "./useSaving";

/** From one block to the next, px: a block is 132 wide. */
const APART = 160;
const FIT = { padding: 0.08, maxZoom: 1.2 };

/** The diagram of a system, or of a system inside of it, with everything that edits it. */
export function Workbench({ id, catalogue, draftOf }: { id: string; catalogue: Catalogue; draftOf: string | null }) {
  const { t } = useTranslation();
  const flow = useReactFlow();
  const { document: root, places, routes, edit, place } = useEditor();
  const { undo, redo } = useEditor.temporal.getState();
  const [canUndo, canRedo] = useStore(useEditor.temporal, useShallow((history) => [history.pastStates.length > 0, history.futureStates.length > 0]));
  const [query, setQuery] = useSearchParams();
  const within = query.get("in") ?? "";
  const asked = useMemo(() => within.split(".").filter(Boolean), [within]);
  const found = scoped(root, asked);
  const scope = found ? asked : NO_SCOPE;
  const document = found ?? root;
  const scopeKey = scope.join(".");
  const own = places[scopeKey];
  const frames = query.get("frames") === "1";
  const [selected, setSelected] = useState<readonly string[]>([]);
  const [wire, setWire] = useState<string | null>(null);
  const [quick, setQuick] = useState<{ mode: Mode; at?: Point; from?: End | null } | null>(null);
  const [told, setTold] = useState(draftOf !== null);
  const [notice, setNotice] = useState<string | null>(null);
  const check = useCheck(root);
  const saving = useSaving(id);
  const pointer = pointerOf(scope);

  const latest = useRef({ document, own, scope, scopeKey });
  latest.current = { document, own, scope, scopeKey };
  /** One gesture: a new version of what is looked at, with places for what is new in it. */
  const change = useCallback(
    (next: SystemDocument, more?: Record<string, Point>) => {
      const now = latest.current;
      const state = useEditor.getState();
      edit({ document: withScoped(state.document, now.scope, () => next), ...(more ? { places: { ...state.places, [now.scopeKey]: { ...now.own, ...more } } } : {}) });
    },
    [edit],
  );
  const pick = useCallback((...names: string[]) => {
    setSelected(names);
    setWire(null);
  }, []);
  const go = useCallback(
    (to: readonly string[], ...names: string[]) => {
      setQuery((before) => {
        const next = new URLSearchParams(before);
        if (to.length > 0) next.set("in", to.join("."));
        else next.delete("in");
        return next;
      });
      pick(...names);
    },
    [setQuery, pick],
  );

  const arrange = useCallback(
    async (asked = true) => {
      const laid = await laidOut(document, catalogue);
      // What was put somewhere while the layout was computed stays there.
      const now = useEditor.getState().places[scopeKey];
      place(scopeKey, asked ? { ...now, ...laid.places } : { ...laid.places, ...now }, laid.routes);
      requestAnimationFrame(() => void flow.fitView(FIT));
    },
    [document, catalogue, scopeKey, place, flow],
  );
  useEffect(() => {
    // A diagram that nobody has arranged is laid out once; blocks that come later are put where they were dropped.
    if (own === undefined && Object.keys(document.blocks).length > 0) void arrange(false);
    else requestAnimationFrame(() => void flow.fitView(FIT));
  }, [scopeKey]);

  const problems = useMemo(() => {
    const map = new Map<string, string>();
    for (const fault of check.problem?.document.errors ?? []) {
      const name = blockAt(fault.pointer, pointer, document);
      if (name !== undefined && !map.has(name)) map.set(name, fault.detail);
    }
    return map;
  }, [check.problem, pointer, document]);
  const warnings = useMemo(() => new Map(check.warnings.flatMap((warning) => (blockAt(warning.pointer, pointer, document) === undefined ? [] : [[blockAt(warning.pointer, pointer, document)!, warning.detail] as const]))), [check.warnings, pointer, document]);
  const nodes = useNodes({ document, catalogue, places: own, problems, warnings, selected });
  const edges = useEdges({ document, catalogue, places: own, routes: routes[scopeKey], wire });
  const opened = useFrames(document, catalogue, frames, selected, wire, problems);
  useEffect(() => {
    if (opened.ready) requestAnimationFrame(() => void flow.fitView(FIT));
  }, [frames, opened.ready, flow]);

  const add = useCallback(
    (name: string, block: Block, at: Point | null, from: End | null) => {
      const { document: now, own: there } = latest.current;
      const ports = portsOf(block, catalogue);
      const centre = () => {
        const canvas = window.document.querySelector(".react-flow")!.getBoundingClientRect();
        return flow.screenToFlowPosition({ x: canvas.x + canvas.width / 2, y: canvas.y + canvas.height / 2 });
      };
      const point = freePlace(at ?? (from ? beside(from, now, there, catalogue, block) : centre()), now, there, catalogue, block);
      const next = { ...now, blocks: { ...now.blocks, [name]: block } };
      const to = ports.inputs[0];
      change(from && to ? connect(next, catalogue, from, { block: name, port: to }) : next, { [name]: point });
      pick(name);
      requestAnimationFrame(() => {
        const view = flow.getViewport();
        const canvas = window.document.querySelector(".react-flow")!.getBoundingClientRect();
        const [x, y] = [point.x * view.zoom + view.x, point.y * view.zoom + view.y];
        // What was just added is seen.
        if (x < 0 || y < 0 || x > canvas.width - 150 * view.zoom || y > canvas.height - 80 * view.zoom) void flow.fitView(FIT);
      });
    },
    [catalogue, change, flow, pick],
  );
  const wired = useCallback((from: End, to: End) => change(connect(latest.current.document, catalogue, from, to)), [catalogue, change]);

  const moved = useCallback((spots: Record<string, Point>) => edit({ places: { ...useEditor.getState().places, [latest.current.scopeKey]: spots } }), [edit]);

  const remove = () => {
    if (frames) return;
    if (wire?.startsWith(OUT)) change({ ...document, outputs: without(document.outputs, (name) => OUT + name === wire) });
    else if (wire) {
      const [block = "", port = ""] = wire.split(".");
      change(disconnect(document, catalogue, { block, port }));
    } else if (selected.length > 0) {
      const { blocks, outputs } = split(selected);
      const next = removeBlocks(document, blocks);
      change({ ...next, outputs: without(next.outputs, (name) => outputs.has(name)) });
    }
    pick();
  };
  const group = () => {
    const { blocks, outputs } = split(selected);
    if (blocks.size === 0) return;
    const spots = [...blocks].flatMap((name) => (own?.[name] ? [own[name]] : []));
    const made = grouped(document, blocks, outputs, catalogue);
    const state = useEditor.getState();
    const inner = [...scope, made.name].join(".");
    const middle = (axis: "x" | "y") => Math.round(spots.reduce((sum, spot) => sum + spot[axis], 0) / Math.max(spots.length, 1) / 10) * 10;
    const moved = Object.fromEntries(Object.entries(own ?? {}).filter(([name]) => blocks.has(name) || outputs.has(name.slice(OUT.length))));
    const whole = Object.keys(moved).length === Object.keys(made.document.blocks[made.name]!.system!.blocks).length + Object.keys(made.document.blocks[made.name]!.system!.outputs).length;
    edit({
      document: withScoped(root, scope, () => made.document),
      places: { ...state.places, ...(whole ? { [inner]: moved } : {}), [scopeKey]: { ...own, [made.name]: { x: middle("x"), y: middle("y") } } },
    });
    if (made.doubled.length > 0) setNotice(t("diagram.doubled", { names: made.doubled.join(", ") }));
    pick(made.name);
  };
  const ungroup = () => {
    const one = selected.length === 1 ? dissolved(document, selected[0]!, catalogue) : undefined;
    if (!one) return;
    const from = own?.[selected[0]!] ?? { x: 0, y: 0 };
    // Beside each other: none lies over another.
    change(one.document, Object.fromEntries(one.names.map((name, i) => [name, { x: from.x + APART * i, y: from.y }])));
    pick(...one.names);
  };
  const open = (name: string) => {
    const path = name.split(".");
    if (scoped(document, path)) go([...scope, ...path]);
  };

  /** The block whose values are shown, and the system that it is in; where subsystems stand open it may be deep inside. */
  const one = selected.length === 1 && !selected[0]!.startsWith(OUT) ? selected[0]! : null;
  const deep = frames && one ? one.split(".").slice(0, -1) : NO_SCOPE;
  const shown = scoped(document, deep) ?? document;
  const shownName = one?.split(".").at(-1) ?? null;
  /** A block keeps its place under its new name, and so does what is inside of it. */
  const rename = (before: string, after: string) => {
    const state = useEditor.getState();
    const [was, is] = [[...scope, ...deep, before].join("."), [...scope, ...deep, after].join(".")];
    const renamed = Object.fromEntries(
      Object.entries(state.places).map(([path, spots]) => [
        path === was || path.startsWith(`${was}.`) ? is + path.slice(was.length) : path,
        path === [...scope, ...deep].join(".") ? Object.fromEntries(Object.entries(spots).map(([name, spot]) => [name === before ? after : name, spot])) : spots,
      ]),
    );
    edit({ document: withScoped(root, [...scope, ...deep], (inner) => renameBlock(inner, before, after)), places: renamed });
    pick([...deep, after].join("."));
  };
  useKeys({
    save: saving.save,
    undo,
    redo,
    remove,
    group,
    ungroup,
    arrange: () => void arrange(),
    all: () => pick(...nodes.map((node) => node.id)),
    add: () => !frames && setQuick({ mode: "add", from: one && document.blocks[one] ? firstOutput(one, document, catalogue) : null }),
    connect: () => !frames && one && setQuick({ mode: "connect" }),
    output: () => !frames && one && setQuick({ mode: "output" }),
    find: () => setQuick({ mode: "find" }),
    frames: () => toggleFrames(),
    enter: () => {
      if (one && scoped(document, one.split("."))) open(one);
      else if (one) window.document.querySelector<HTMLElement>("[data-inspector] [data-parameter] input, [data-inspector] [data-parameter] select, [data-inspector] input")?.focus();
    },
    rename: () => window.document.querySelector<HTMLInputElement>("[data-inspector] [data-name] input")?.select(),
    up: () => scope.length > 0 && go(scope.slice(0, -1), scope.at(-1)!),
    clear: () => pick(),
  });
  useClipboard({
    document,
    selected: useMemo(() => split(selected).blocks, [selected]),
    onCut: remove,
    onPaste: (next, names, from) => {
      const spots = names.map((name, i) => [name, { x: (own?.[from[i]!]?.x ?? 80) + 40, y: (own?.[from[i]!]?.y ?? 80) + 60 }] as const);
      if (frames) return;
      change(next, Object.fromEntries(spots));
      pick(...names);
    },
  });
  const toggleFrames = () => {
    setQuery((before) => {
      const next = new URLSearchParams(before);
      if (frames) next.delete("frames");
      else next.set("frames", "1");
      return next;
    }, { replace: true });
    pick();
  };

  const blocker = useBlocker(({ currentLocation, nextLocation }) => saving.dirty && currentLocation.pathname !== nextLocation.pathname);
  const signal = wire && ((frames ? opened.edges : edges).find((edge) => edge.id === wire)?.data?.from as string | undefined);

  return (
    <div className={classes.page}>
      <aside className={classes.palette} aria-label={t("diagram.palette")}>
        <Palette catalogue={catalogue} onAdd={(entry) => add(freeName(entry.kind, Object.keys(document.blocks)), blockOf(entry), null, null)} />
      </aside>
      <div className={classes.middle}>
        <Toolbar
          root={root.name || t("diagram.system")}
          scope={scope}
          check={check}
          saving={saving}
          frames={frames}
          grouping={!frames && split(selected).blocks.size > 0}
          canUndo={canUndo}
          canRedo={canRedo}
          onGo={(to) => go(to)}
          onUndo={() => undo()}
          onRedo={() => redo()}
          onArrange={() => void arrange()}
          onFrames={toggleFrames}
          onGroup={group}
          onAdd={() => setQuick({ mode: "add", from: one ? firstOutput(one, document, catalogue) : null })}
        />
        {told && draftOf && (
          <Alert color="blue" variant="outline" m={6} p="xs" role="status" withCloseButton onClose={() => setTold(false)} closeButtonLabel={t("diagram.fineSo")}>
            <Group gap="xs">
              <Text span fz="sm">
                {t("diagram.draft")} <When at={draftOf} />
              </Text>
              <Button
                variant="default"
                onClick={() => {
                  saving.discard();
                  setTold(false);
                }}
              >
                {t("diagram.dropDraft")}
              </Button>
            </Group>
          </Alert>
        )}
        {saving.waiting && (
          <Alert color="orange" variant="outline" m={6} p="xs" role="status" data-testid="waiting">
            {t("diagram.waiting")}
          </Alert>
        )}
        {saving.overtaken && !saving.conflict && (
          <Alert color="orange" variant="outline" m={6} p="xs" role="status" data-testid="overtaken">
            <Group gap="xs">
              <Text span fz="sm">
                {t("diagram.overtaken")}
              </Text>
              <Button variant="default" onClick={() => (saving.dirty ? saving.compare() : saving.discard())}>
                {saving.dirty ? t("diagram.compare") : t("diagram.reload")}
              </Button>
            </Group>
          </Alert>
        )}
        {notice && (
          <Alert color="blue" variant="outline" m={6} p="xs" role="status" withCloseButton onClose={() => setNotice(null)} closeButtonLabel={t("diagram.fineSo")}>
            {notice}
          </Alert>
        )}
        {check.problem && <Faults problem={check.problem} onGo={(to, name) => go(to, name)} />}
        {saving.failure !== null && <ProblemAlert error={saving.failure} m={6} />}
        <div className={classes.holder}>
          <Canvas
            nodes={frames ? opened.nodes : nodes}
            edges={frames ? opened.edges : edges}
            fixed={frames}
            onSelect={setSelected}
            onWire={setWire}
            onMove={moved}
            onConnect={wired}
            onOpen={open}
            onDrop={(kind, at) => catalogue.get(kind) && add(freeName(kind, Object.keys(document.blocks)), blockOf(catalogue.get(kind)!), at, null)}
            onWanted={(at, from) => setQuick({ mode: "add", at, from })}
          />
          {Object.keys(document.blocks).length === 0 && !quick && (
            <div className={classes.empty}>
              <Text fw={600}>{t("diagram.empty")}</Text>
              <Text fz="sm">{t("diagram.emptyDoc")}</Text>
            </div>
          )}
          {quick && (
            <QuickEntry
              key={quick.mode}
              mode={quick.mode}
              document={document}
              catalogue={catalogue}
              selected={one}
              from={quick.from ?? null}
              paths={quick.mode === "find" ? pathsOf(root) : NO_SCOPE}
              onAdd={(name, block) => add(name, block, quick.at ?? null, quick.from ?? null)}
              onConnect={wired}
              onOutput={(name, from) => change(withOutput(document, catalogue, name, from), own?.[from.block] ? { [OUT + name]: { x: own[from.block]!.x + 200, y: own[from.block]!.y - 50 + 40 * Object.keys(document.outputs).length } } : undefined)}
              onFind={(path) => go(path.split(".").slice(0, -1), path.split(".").at(-1)!)}
              onClose={() => setQuick(null)}
            />
          )}
        </div>
        {signal && (
          <div className={classes.signal}>
            <SignalPlot document={root} from={[...scope, signal].join(".")} onClose={() => setWire(null)} />
          </div>
        )}
      </div>
      <aside className={classes.inspector} aria-label={t("diagram.inspector")} data-inspector>
        <Inspector
          key={scopeKey}
          document={shown}
          catalogue={catalogue}
          selected={shownName}
          problem={check.problem}
          pointer={pointer + pointerOf(deep).slice("/system".length)}
          onEdit={(next) => change(withScoped(document, deep, () => next))}
          onSelect={(name) => (name ? pick([...deep, name].join(".")) : pick())}
          onRename={rename}
          onEnter={(name) => go([...scope, ...deep, name])}
        />
      </aside>
      {saving.conflict && <ConflictDialog conflict={saving.conflict} busy={saving.saving} onClose={saving.later} onMerge={(merged) => saving.decide(merged, saving.conflict!)} onTakeTheirs={() => saving.takeTheirs(saving.conflict!)} />}
      {blocker.state === "blocked" && (
        <div className={classes.leave} role="alertdialog" aria-label={t("diagram.leave")}>
          <Text fz="sm">{t("diagram.leave")}</Text>
          <Button variant="default" onClick={() => blocker.reset()} autoFocus>
            {t("diagram.stay")}
          </Button>
          <Button onClick={() => blocker.proceed()}>{t("diagram.goOn")}</Button>
        </div>
      )}
    </div>
  );
}

const NO_SCOPE: readonly string[] = [];

const pointerOf = (scope: readonly string[]): string => `/system${scope.map((name) => `/blocks/${name}/system`).join("")}`;

/** The block, in the system at `pointer`, that a fault belongs to; one of a connection belongs to the block it leads to. */
function blockAt(place: string, pointer: string, document: SystemDocument): string | undefined {
  if (!place.startsWith(`${pointer}/`)) return undefined;
  const rest = place.slice(pointer.length);
  const wire = /^\/connections\/(\d+)/.exec(rest);
  if (wire) return document.connections?.[Number(wire[1])]?.to.split(".")[0];
  return /^\/blocks\/([^/]+)/.exec(rest)?.[1];
}

function split(selected: readonly string[]): { blocks: Set<string>; outputs: Set<string> } {
  return { blocks: new Set(selected.filter((name) => !name.startsWith(OUT))), outputs: new Set(selected.filter((name) => name.startsWith(OUT)).map((name) => name.slice(OUT.length))) };
}

const without = <T,>(record: Record<string, T>, gone: (name: string) => boolean): Record<string, T> => Object.fromEntries(Object.entries(record).filter(([name]) => !gone(name)));

function firstOutput(name: string, document: SystemDocument, catalogue: Catalogue): End | null {
  const port = document.blocks[name] && portsOf(document.blocks[name], catalogue).outputs[0];
  return port === undefined ? null : { block: name, port };
}
