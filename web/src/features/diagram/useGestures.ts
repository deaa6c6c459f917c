import { useReactFlow } from "@xyflow/react";
import { useCallback, useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import type { Block, SystemDocument } from "@/shared/api/types";
import { OUT } from "./graph";
import { dissolved, grouped } from "./group";
import { connect, disconnect, portsOf, removeBlocks, renameBlock, scoped, withOutput, withScoped, type Catalogue, type End } from "./model";
import { beside, freePlace } from "./spots";
import { useEditor, type Point } from "./store";
import { FIT } from "./useArranging";
import { ROOT, type useView } from "./useView";

/** From one block to the next, px: a block is 132 wide. */
const APART = 160;

/** What can be done to the system that is looked at: each is one entry of the history, with the places of what is new. */
export function useGestures(view: ReturnType<typeof useView>, catalogue: Catalogue) {
  const { t } = useTranslation();
  const flow = useReactFlow();
  const { document: root, places, edit } = useEditor();
  const { document, scope, scopeKey, frames, selected, wire, pick } = view;
  const own = places[scopeKey];
  const [notice, setNotice] = useState<string | null>(null);

  const latest = useRef({ document, own, scope, scopeKey });
  latest.current = { document, own, scope, scopeKey };
  const change = useCallback(
    (next: SystemDocument, more?: Record<string, Point>) => {
      const now = latest.current;
      const state = useEditor.getState();
      edit({ document: withScoped(state.document, now.scope, () => next), ...(more ? { places: { ...state.places, [now.scopeKey]: { ...now.own, ...more } } } : {}) });
    },
    [edit],
  );
  const add = useCallback(
    (name: string, block: Block, at: Point | null, from: End | null) => {
      const { document: now, own: there } = latest.current;
      const ports = portsOf(block, catalogue);
      const centre = () => {
        const canvas = window.document.querySelector(".react-flow")!.getBoundingClientRect();
        return flow.screenToFlowPosition({ x: canvas.x + canvas.width / 2, y: canvas.y + canvas.height / 2 });
      };
      // Where it was dropped it stays, and so does the view.
      const point = at && !from ? at : freePlace(at ?? (from ? beside(from, now, there, catalogue, block) : centre()), now, there, catalogue, block);
      const next = { ...now, blocks: { ...now.blocks, [name]: block } };
      const to = ports.inputs[0];
      change(from && to ? connect(next, catalogue, from, { block: name, port: to }) : next, { [name]: point });
      pick(name);
      if (at) return;
      requestAnimationFrame(() => {
        const { x: left, y: top, zoom } = flow.getViewport();
        const canvas = window.document.querySelector(".react-flow")!.getBoundingClientRect();
        const [x, y] = [point.x * zoom + left, point.y * zoom + top];
        // What was just added is seen.
        if (x < 0 || y < 0 || x > canvas.width - 150 * zoom || y > canvas.height - 80 * zoom) void flow.fitView(FIT);
      });
    },
    [catalogue, change, flow, pick],
  );
  const wired = useCallback((from: End, to: End) => change(connect(latest.current.document, catalogue, from, to)), [catalogue, change]);
  const moved = useCallback((spots: Record<string, Point>) => edit({ places: { ...useEditor.getState().places, [latest.current.scopeKey]: spots } }), [edit]);

  const output = (name: string, from: End) => {
    const there = own?.[from.block];
    change(withOutput(document, catalogue, name, from), there && { [OUT + name]: { x: there.x + 200, y: there.y - 50 + 40 * Object.keys(document.outputs).length } });
  };
  /** An output keeps its place under its new name. */
  const renameOutput = (before: string, after: string) => {
    const spot = own?.[OUT + before];
    change({ ...document, outputs: Object.fromEntries(Object.entries(document.outputs).map(([name, end]) => [name === before ? after : name, end])) }, spot && { [OUT + after]: spot });
    if (selected.includes(OUT + before)) pick(OUT + after);
  };
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
  const paste = (next: SystemDocument, names: string[], from: string[]) => {
    if (frames) return;
    change(next, Object.fromEntries(names.map((name, i) => [name, { x: (own?.[from[i]!]?.x ?? 80) + 40, y: (own?.[from[i]!]?.y ?? 80) + 60 }])));
    pick(...names);
  };
  const group = () => {
    const { blocks, outputs } = split(selected);
    if (blocks.size === 0) return;
    const spots = [...blocks].flatMap((name) => (own?.[name] ? [own[name]] : []));
    const made = grouped(document, blocks, outputs, catalogue);
    const state = useEditor.getState();
    const inner = made.document.blocks[made.name]!.system!;
    const middle = (axis: "x" | "y") => Math.round(spots.reduce((sum, spot) => sum + spot[axis], 0) / Math.max(spots.length, 1) / 10) * 10;
    const inside = Object.fromEntries(Object.entries(own ?? {}).filter(([name]) => blocks.has(name) || outputs.has(name.slice(OUT.length))));
    const whole = Object.keys(inside).length === Object.keys(inner.blocks).length + Object.keys(inner.outputs).length;
    edit({
      document: withScoped(root, scope, () => made.document),
      places: { ...state.places, ...(whole ? { [[...scope, made.name].join(".")]: inside } : {}), [scopeKey]: { ...own, [made.name]: { x: middle("x"), y: middle("y") } } },
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

  /** The block whose values are shown, and the system that it is in; where subsystems stand open it may be deep inside. */
  const one = selected.length === 1 && !selected[0]!.startsWith(OUT) ? selected[0]! : null;
  const deep = frames && one ? one.split(".").slice(0, -1) : ROOT;
  /** A block keeps its place under its new name, and so does what is inside of it. */
  const rename = (before: string, after: string) => {
    const holder = [...scope, ...deep];
    const [was, is] = [[...holder, before].join("."), [...holder, after].join(".")];
    const renamed = Object.fromEntries(
      Object.entries(useEditor.getState().places).map(([path, spots]) => [
        path === was || path.startsWith(`${was}.`) ? is + path.slice(was.length) : path,
        path === holder.join(".") ? Object.fromEntries(Object.entries(spots).map(([name, spot]) => [name === before ? after : name, spot])) : spots,
      ]),
    );
    edit({ document: withScoped(root, holder, (inner) => renameBlock(inner, before, after)), places: renamed });
    pick([...deep, after].join("."));
  };
  return { change, add, wired, moved, output, remove, paste, group, ungroup, rename, renameOutput, notice, read: () => setNotice(null), one, deep, shown: scoped(document, deep) ?? document };
}

/** Blocks and outputs of a selection apart. */
export function split(selected: readonly string[]): { blocks: Set<string>; outputs: Set<string> } {
  return { blocks: new Set(selected.filter((name) => !name.startsWith(OUT))), outputs: new Set(selected.filter((name) => name.startsWith(OUT)).map((name) => name.slice(OUT.length))) };
}

const without = <T,>(record: Record<string, T>, gone: (name: string) => boolean): Record<string, T> => Object.fromEntries(Object.entries(record).filter(([name]) => !gone(name)));
