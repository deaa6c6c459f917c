/** What is selected, as an address says it: blocks and outputs by name, or one connection by the input that it feeds. */
export interface Selection {
  names: readonly string[];
  wire: string | null;
}

export const NOTHING_SELECTED: Selection = { names: [], wire: null };

/** So many names an address holds; who selects more has selected everything. */
const MOST = 100;

export function selectionAt(query: URLSearchParams): Selection {
  return { names: (query.get("at") ?? "").split(",").filter(Boolean), wire: query.get("signal") };
}

/** The same address with another selection; itself where it says so already. */
export function withSelection(query: URLSearchParams, { names, wire }: Selection): URLSearchParams {
  const next = new URLSearchParams(query);
  if (names.length > 0 && names.length <= MOST) next.set("at", names.join(","));
  else next.delete("at");
  if (wire !== null) next.set("signal", wire);
  else next.delete("signal");
  return next.toString() === query.toString() ? query : next;
}
