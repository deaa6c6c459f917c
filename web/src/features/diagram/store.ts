import { create } from "zustand";
import type { SystemDocument } from "@/shared/api/types";

export interface Point {
  x: number;
  y: number;
}
/** Where blocks stand, by the path of the system they are in; documents say nothing of it. */
export type Places = Record<string, Record<string, Point>>;

interface Version {
  document: SystemDocument;
  places: Places;
}

interface Editor extends Version {
  past: Version[];
  future: Version[];
  /** What the service has: with `etag` it is told which version an edit was made from. */
  base: SystemDocument;
  etag: string;
  start(document: SystemDocument, etag: string, places: Places): void;
  /** One entry of the history for each gesture. */
  edit(change: Partial<Version>): void;
  /** Places that nobody chose (automatic layout) are no gesture. */
  place(places: Places): void;
  undo(): void;
  redo(): void;
  saved(document: SystemDocument, etag: string): void;
}

const LONGEST = 200;

export const useEditor = create<Editor>((set) => ({
  document: { blocks: {}, outputs: {} },
  places: {},
  past: [],
  future: [],
  base: { blocks: {}, outputs: {} },
  etag: "*",
  start: (document, etag, places) => set({ document, base: document, etag, places, past: [], future: [] }),
  edit: (change) =>
    set((now) => ({
      ...change,
      past: [...now.past.slice(-LONGEST + 1), { document: now.document, places: now.places }],
      future: [],
    })),
  place: (places) => set({ places }),
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

const KEY = (id: string) => `servotune-places-${id}`;

export function keptPlaces(id: string): Places {
  try {
    return JSON.parse(localStorage.getItem(KEY(id)) ?? "{}") as Places;
  } catch {
    return {};
  }
}

export function keepPlaces(id: string, places: Places): void {
  localStorage.setItem(KEY(id), JSON.stringify(places));
}
