import { useQuery, useQueryClient } from "@tanstack/react-query";
import { useCallback, useEffect, useMemo, useState } from "react";
import { isProblem } from "@/shared/api/problem";
import { saveSystem, systemQuery } from "@/shared/api/systems";
import type { SystemDocument } from "@/shared/api/types";
import type { Conflict } from "./ConflictDialog";
import { dropDraft, keepDraft, keepPicture } from "./kept";
import { same } from "./merge";
import { useEditor } from "./store";

/** A service that does not answer, or has no time: what is edited stays, and is saved when it comes back. */
const AGAIN = 2000;
const away = (error: unknown) => isProblem(error) && (error.status === 0 || error.status === 429 || error.status >= 502);

/** Saving, and all that may come between: somebody was faster, the service is away, the page is closed. */
export function useSaving(id: string) {
  const queries = useQueryClient();
  const { document, base, etag, places, routes, edit, saved, start } = useEditor();
  const [conflict, setConflict] = useState<Conflict | null>(null);
  const [saving, setSaving] = useState(false);
  const [failure, setFailure] = useState<unknown>(null);
  const [waiting, setWaiting] = useState(false);
  const dirty = useMemo(() => document !== base && !same(document, base), [document, base]);
  // Others save, too: looked at now and then, so that one is told before the work is done twice.
  const latest = useQuery({ ...systemQuery(id), refetchInterval: 20_000, refetchOnWindowFocus: true, retry: false }).data;
  const overtaken = latest !== undefined && latest.etag !== etag && revision(latest.etag) > revision(etag);

  useEffect(() => keepPicture(id, { places, routes }), [id, places, routes]);
  useEffect(() => {
    if (dirty) keepDraft(id, { document, base, etag, at: new Date().toISOString() });
    else dropDraft(id);
  }, [id, dirty, document, base, etag]);

  const meet = useCallback(
    async (mine: SystemDocument) => {
      const theirs = await queries.fetchQuery({ ...systemQuery(id), staleTime: 0 });
      // What was saved although its answer was lost on the way is no conflict.
      if (same(theirs.document, mine)) return saved(mine, theirs.etag);
      setConflict({ base: useEditor.getState().base, mine, theirs: theirs.document, etag: theirs.etag });
    },
    [id, queries, saved],
  );
  const save = useCallback(
    async (next: SystemDocument, tag: string) => {
      const begun = useEditor.getState().document;
      setSaving(true);
      setFailure(null);
      try {
        const { data, etag: now } = await saveSystem(id, next, tag);
        // A merge takes the place of what was there; what is edited while it is being saved stays, and is not saved yet.
        if (next !== begun) edit({ document: next });
        saved(next, now);
        setWaiting(false);
        setConflict(null);
        queries.setQueryData(systemQuery(id).queryKey, { ...data, etag: now, document: next });
        void queries.invalidateQueries({ queryKey: ["system", id, "revisions"] });
      } catch (error) {
        setWaiting(away(error));
        if (isProblem(error, 412)) await meet(next).catch(setFailure);
        else setFailure(error);
      } finally {
        setSaving(false);
      }
    },
    [id, edit, saved, queries, meet],
  );
  useEffect(() => {
    if (!waiting || saving) return;
    const timer = setTimeout(() => void save(useEditor.getState().document, useEditor.getState().etag), AGAIN);
    return () => clearTimeout(timer);
  }, [waiting, saving, save]);

  return {
    dirty,
    saving,
    waiting,
    failure: waiting ? null : failure,
    overtaken,
    conflict,
    save: () => void (dirty && save(document, etag)),
    /** What others have saved, beside what is here. */
    compare: () => void meet(document).catch(setFailure),
    decide: (merged: SystemDocument, found: Conflict) => void save(merged, found.etag),
    takeTheirs: (found: Conflict) => {
      start(found.theirs, found.theirs, found.etag, { places, routes });
      setConflict(null);
    },
    later: () => setConflict(null),
    /** Back to what the service has. */
    discard: () => {
      if (latest) start(latest.document, latest.document, latest.etag, { places, routes });
    },
  };
}

const revision = (etag: string): number => Number(etag.replaceAll(/\D/g, ""));
