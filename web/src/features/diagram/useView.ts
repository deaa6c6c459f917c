import { useCallback, useEffect, useMemo, useRef, useState } from "react";
import { useLocation, useNavigation, useNavigationType, useSearchParams } from "react-router";
import type { SystemDocument } from "@/shared/api/types";
import { OUT } from "./graph";
import { scoped } from "./model";
import { NOTHING_SELECTED, selectionAt, withSelection, type Selection } from "./selection";

/** Milliseconds of rest after which the address follows a selection: browsers refuse more than a few changes of it a second. */
const REST = 250;
export const ROOT: readonly string[] = [];

/** What of a system is looked at: a subsystem of it, all of them opened, what is selected. A link shows the same. */
export function useView(root: SystemDocument) {
  const [query, setQuery] = useSearchParams();
  const within = query.get("in") ?? "";
  const asked = useMemo(() => within.split(".").filter(Boolean), [within]);
  const found = scoped(root, asked);
  const scope = found ? asked : ROOT;
  const document = found ?? root;
  const frames = query.get("frames") === "1";

  const [selection, setSelection] = useState<Selection>(() => selectionAt(query));
  const idle = useNavigation().state === "idle";
  useEffect(() => {
    const next = withSelection(query, selection);
    // Whoever is on the way to another page is not called back for a selection.
    if (next === query || !idle) return;
    const timer = setTimeout(() => setQuery(next, { replace: true, preventScrollReset: true }), REST);
    return () => clearTimeout(timer);
  }, [query, setQuery, selection, idle]);
  const { key } = useLocation();
  const way = useNavigationType();
  const shown = useRef(key);
  useEffect(() => {
    if (shown.current === key) return;
    shown.current = key;
    if (way === "POP") setSelection(selectionAt(query));
  }, [key, way, query]);

  const pick = useCallback((...names: string[]) => setSelection({ names, wire: null }), []);
  const pickWire = useCallback((wire: string | null) => setSelection((before) => ({ ...before, wire })), []);
  const select = useCallback((change: (before: readonly string[]) => string[]) => setSelection((before) => ({ ...before, names: change(before.names) })), []);
  const go = useCallback(
    (to: readonly string[], ...names: string[]) => {
      setQuery((before) => {
        const next = withSelection(before, { names, wire: null });
        const there = new URLSearchParams(next);
        if (to.length > 0) there.set("in", to.join("."));
        else there.delete("in");
        return there;
      });
      pick(...names);
    },
    [setQuery, pick],
  );
  const toggleFrames = () => {
    setQuery(
      (before) => {
        const next = new URLSearchParams(withSelection(before, NOTHING_SELECTED));
        if (frames) next.delete("frames");
        else next.set("frames", "1");
        return next;
      },
      { replace: true },
    );
    pick();
  };
  const { wire } = selection;
  // A link may name what is no longer there, and so may a step back in the history.
  const selected = useMemo(() => {
    const there = selection.names.filter((name) => isIn(document, name));
    return there.length === selection.names.length ? selection.names : there;
  }, [document, selection.names]);
  return { document, scope, scopeKey: scope.join("."), frames, selected, wire, select, pick, pickWire, go, toggleFrames };
}

/** Whether a document has this block, maybe deep inside, or this output. */
function isIn(document: SystemDocument, name: string): boolean {
  if (name.startsWith(OUT)) return document.outputs[name.slice(OUT.length)] !== undefined;
  const path = name.split(".");
  return scoped(document, path.slice(0, -1))?.blocks[path.at(-1)!] !== undefined;
}
