import type { ProblemForm } from "./search";

/** What a panel showed last: its address, and the search that belongs to it. */
export interface Last {
  query: string;
  search: Pick<ProblemForm, "input" | "amplitude" | "loop" | "goals"> & { output: string; values: Record<string, number> };
}

const PLACE = "servotune.panels";
/** Systems that a browser remembers; an address that is longer than this is not kept. */
const MOST = 40;
const LONGEST = 6000;

function all(): [string, Last][] {
  try {
    const kept: unknown = JSON.parse(localStorage.getItem(PLACE) ?? "[]");
    return Array.isArray(kept) ? (kept as [string, Last][]).filter((one) => Array.isArray(one) && typeof one[1]?.query === "string" && typeof one[1].search === "object") : [];
  } catch {
    return [];
  }
}

/** Keeps what the panel of a system shows, in this browser; systems that were not seen for longest are forgotten. */
export function keepLast(system: string, last: Last): void {
  if (last.query.length > LONGEST) return;
  try {
    localStorage.setItem(PLACE, JSON.stringify([[system, last], ...all().filter(([id]) => id !== system)].slice(0, MOST)));
  } catch {
    // Without storage a system opens as it did the first time.
  }
}

export function lastOf(system: string): Last | null {
  return all().find(([id]) => id === system)?.[1] ?? null;
}
