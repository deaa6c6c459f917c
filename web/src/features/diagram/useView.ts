import { useCallback, useEffect, useMemo, useRef, useState } from "react";
import { useLocation, useNavigation, useNavigationType, type NavigateOptions } from "react-router";
import type { SystemDocument } from "@/shared/api/types";
import { useQueryText } from "@/shared/ui/useQueryText";
import { OUT } from "./graph";
import { scoped } from "./model";
import { NOTHING_SELECTED, selectionAt, withSelection, type Selection } from "./selection";

/** Milliseconds of rest after which the address follows a selection: browsers refuse more than a few changes of it a second. */
const REST = 250;
export const ROOT: readonly string[] = [];

/** What of a system is looked at: a subsystem of it, all of them opened, what is selected. A link shows the same. */
export function useView(root: SystemDocument) {
  const [query, setQuery] = useQueryText();
  const within = query.get("in") ?? "";
  const asked = useMemo(() => within.split(".").filter(Boolean), [within]);
  const found = scoped(root, asked);
  const scope = found ? asked : ROOT;
  const document = found ?? root;
  const frames = query.get("frames") === "1";

  const here = viewOf(query);
  // An address arrives later than a state: a selection that was made for another view is none in this one, and not written to it.
  const [held, setHeld] = useState(() => ({ view: here, ...selectionAt(query) }));
  const selection = held.view === here ? held : NOTHING_SELECTED;
  const idle = useNavigation().state === "idle";
  useEffect(() => {
    const next = held.view === here ? withSelection(query, held) : query;
    // Whoever is on the way to another page is not called back for a selection.
    if (next === query || !idle) return;
    const timer = setTimeout(() => setQuery((before) => withSelection(before, held)), REST);
    return () => clearTimeout(timer);
  }, [query, setQuery, held, here, idle]);
  const { key } = useLocation();
  const way = useNavigationType();
  const shown = useRef(key);
  useEffect(() => {
    if (shown.current === key) return;
    shown.current = key;
    if (way === "POP") setHeld({ view: here, ...selectionAt(query) });
  }, [key, way, here, query]);

  const change = useCallback((to: (before: Selection) => Selection) => setHeld((before) => ({ view: here, ...to(before.view === here ? before : NOTHING_SELECTED) })), [here]);
  const pick = useCallback((...names: string[]) => change(() => ({ names, wire: null })), [change]);
  const pickWire = useCallback((wire: string | null) => change(({ names }) => ({ names, wire })), [change]);
  const select = useCallback((to: (before: readonly string[]) => string[]) => change(({ names, wire }) => ({ names: to(names), wire })), [change]);
  const leave = useCallback(
    (names: string[], move: (query: URLSearchParams) => void, options: NavigateOptions = {}) =>
      setQuery((before) => {
        const there = new URLSearchParams(withSelection(before, { names, wire: null }));
        move(there);
        setHeld({ view: viewOf(there), names, wire: null });
        return there;
      }, options),
    [setQuery],
  );
  const go = useCallback((to: readonly string[], ...names: string[]) => leave(names, (query) => (to.length > 0 ? query.set("in", to.join(".")) : query.delete("in"))), [leave]);
  const toggleFrames = () => leave([], (query) => (frames ? query.delete("frames") : query.set("frames", "1")), { replace: true });
  const { wire } = selection;
  // A link may name what is no longer there, and so may a step back in the history.
  const selected = useMemo(() => {
    const there = selection.names.filter((name) => isIn(document, name));
    return there.length === selection.names.length ? selection.names : there;
  }, [document, selection.names]);
  return { document, scope, scopeKey: scope.join("."), frames, selected, wire, select, pick, pickWire, go, toggleFrames };
}

/** Which picture an address asks for: names of blocks mean something in it only. */
const viewOf = (query: URLSearchParams): string => `${query.get("in") ?? ""}?${query.get("frames") ?? ""}`;

/** Whether a document has this block, maybe deep inside, or this output. */
function isIn(document: SystemDocument, name: string): boolean {
  if (name.startsWith(OUT)) return document.outputs[name.slice(OUT.length)] !== undefined;
  const path = name.split(".");
  return scoped(document, path.slice(0, -1))?.blocks[path.at(-1)!] !== undefined;
}
