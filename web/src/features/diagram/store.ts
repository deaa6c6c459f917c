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

interface Version {
  document: SystemDocument;
  places: Places;
}

interface Editor extends Version {
  past: Version[];
  future: Version[];
  routes: Routes;
  /** What the service has: with `etag` it is told which version an edit was made from. */
  base: SystemDocument;
  etag: string;
  start(document: SystemDocument, base: SystemDocument, etag: string, kept: Kept): void;
  /** One entry of the history for each gesture. */
  edit(change: Partial<Version>): void;
  /** Places that nobody chose (automatic layout) are no gesture. */
  place(scope: string, places: Record<string, Point>, routes: Record<string, Route>): void;
  undo(): void;
  redo(): void;
  saved(document: SystemDocument, etag: string): void;
}

const LONGEST = 200;

export const useEditor = create<Editor>((set) => ({
  document: { blocks: {}, outputs: {} },
  places: {},
  routes: {},
  past: [],
  future: [],
  base: { blocks: {}, outputs: {} },
  etag: "*",
  start: (document, base, etag, kept) => set({ document, base, etag, ...kept, past: [], future: [] }),
  edit: (change) =>
    set((now) => ({
      ...change,
      past: [...now.past.slice(-LONGEST + 1), { document: now.document, places: now.places }],
      future: [],
    })),
  place: (scope, places, routes) => set((now) => ({ places: { ...now.places, [scope]: places }, routes: { ...now.routes, [scope]: routes } })),
  undo: () =>
    set((now) => {
      const before = now.past.at(-1);
      return before ? { ...before, past: now.past.slice(0, -1), future: [{ document: now.document, places: now.places }, ...now.future] } : {};
    }),
  redo: () =>
    set((now) => {
      const [next, ...future] = now.future;
      return next ? { ...next, past: [...now.past, { document: now.document, places: now.places }], future } : {};
    }),
  saved: (document, etag) => set({ base: document, etag }),
}));
