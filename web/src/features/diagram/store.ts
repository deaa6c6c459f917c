import { temporal } from "zundo";
import { create } from "zustand";
import type { SystemDocument } from "@/shared/api/types";

export interface Point {
  x: number;
  y: number;
}
/** A connection as it was laid out; it is drawn so as long as its ends are where it begins and ends. */
export type Route = Point[];
/** Where blocks stand, by the path of the system they are in; documents say nothing of it. */
export type Places = Record<string, Record<string, Point>>;
export type Routes = Record<string, Record<string, Route>>;

/** What belongs to the picture and not to the document. */
export interface Kept {
  places: Places;
  routes: Routes;
}

/** What is undone and done again. */
interface Version {
  document: SystemDocument;
  places: Places;
}

interface Editor extends Version {
  routes: Routes;
  /** What the service has: with `etag` it is told which version an edit was made from. */
  base: SystemDocument;
  etag: string;
  start(document: SystemDocument, base: SystemDocument, etag: string, kept: Kept): void;
  /** One entry of the history for each gesture. */
  edit(change: Partial<Version>): void;
  /** Places that nobody chose (automatic layout) are no gesture. */
  place(scope: string, places: Record<string, Point>, routes: Record<string, Route>): void;
  saved(document: SystemDocument, etag: string): void;
}

const LONGEST = 200;
const NOTHING: SystemDocument = { blocks: {}, outputs: {} };

export const useEditor = create<Editor>()(
  temporal(
    (set) => ({
      document: NOTHING,
      places: {},
      routes: {},
      base: NOTHING,
      etag: "*",
      start(document, base, etag, kept) {
        set({ document, base, etag, ...kept });
        useEditor.temporal.getState().clear();
      },
      edit: (change) => set(change),
      place(scope, places, routes) {
        const history = useEditor.temporal.getState();
        history.pause();
        set((now) => ({ places: { ...now.places, [scope]: places }, routes: { ...now.routes, [scope]: routes } }));
        history.resume();
      },
      saved: (document, etag) => set({ base: document, etag }),
    }),
    {
      partialize: ({ document, places }): Version => ({ document, places }),
      equality: (before, now) => before.document === now.document && before.places === now.places,
      limit: LONGEST,
    },
  ),
);
