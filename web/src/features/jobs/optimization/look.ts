import { useQueryText } from "@/shared/ui/useQueryText";
import type { GridMap } from "./map";

/** What of a result is looked at: one step of the search, one point of its front, or one cell of its map. */
const LOOKED_AT = ["step", "point", "cell"] as const;
export type Looked = (typeof LOOKED_AT)[number];

/** What the address says of the view, and how it is told something else. */
export function useLook() {
  const [query, setQuery] = useQueryText();
  const put = (part: Record<string, string | null>) =>
    setQuery((next) => {
      for (const [key, value] of Object.entries(part)) if (value === null) next.delete(key);
      else next.set(key, value);
      return next;
    });
  /** Of step, point and cell there is one at a time. */
  const look = (at: Looked, place: string | null) => put({ ...Object.fromEntries(LOOKED_AT.map((key) => [key, null])), [at]: place });
  return { query, put, look };
}

/** A place in a list as the address holds it, if it is one. */
export function placeIn(text: string | null, count: number): number | null {
  const place = Number(text);
  return text !== null && text !== "" && Number.isInteger(place) && place >= 0 && place < count ? place : null;
}

/** Several places in a list, in their order; all where the address names none. */
export function placesIn(text: string | null, count: number): number[] {
  const found = (text ?? "").split(",").flatMap((one) => placeIn(one, count) ?? []);
  return found.length > 0 ? [...new Set(found)] : Array.from({ length: count }, (_, i) => i);
}

/** A cell of a map: the place on each of its axes. */
export function cellIn(text: string | null, { axes }: GridMap): number[] | null {
  const lengths = Object.values(axes).map((axis) => axis.length);
  const parts = (text ?? "").split(",");
  const found = parts.flatMap((one, i) => placeIn(one, lengths[i] ?? 0) ?? []);
  return text && parts.length === lengths.length && found.length === lengths.length ? found : null;
}
