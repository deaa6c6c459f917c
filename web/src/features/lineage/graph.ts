import type { components } from "@/shared/api/schema";

export type LineageReply = components["schemas"]["LineageReply"];
export type LineageNode = components["schemas"]["LineageNode"];

export const BOX = { width: 190, height: 62, across: 80, down: 26 };

/**
 * Places for a graph without loops: a column for the longest way from a source, and in each column the order of those that its nodes
 * come from, which keeps most edges from crossing.
 */
export function placed(nodes: { id: string }[], edges: { from: string; to: string }[]): Map<string, { x: number; y: number }> {
  const sources = new Map<string, string[]>(nodes.map(({ id }) => [id, []]));
  for (const { from, to } of edges) if (sources.has(from)) sources.get(to)?.push(from);
  const columns = new Map<string, number>();
  const column = (id: string, path: Set<string>): number => {
    const known = columns.get(id);
    if (known !== undefined) return known;
    // What the service sends has no loops; one would end here instead of never.
    if (path.has(id)) return 0;
    const further = new Set(path).add(id);
    const found = Math.max(-1, ...(sources.get(id) ?? []).map((from) => column(from, further))) + 1;
    columns.set(id, found);
    return found;
  };
  for (const { id } of nodes) column(id, new Set());
  const rows = new Map<string, number>();
  const places = new Map<string, { x: number; y: number }>();
  for (let k = 0; k <= Math.max(0, ...columns.values()); k++) {
    const here = nodes.filter(({ id }) => columns.get(id) === k);
    const wanted = new Map(here.map(({ id }, i) => {
      const from = (sources.get(id) ?? []).map((source) => rows.get(source) ?? 0);
      return [id, from.length > 0 ? from.reduce((sum, row) => sum + row, 0) / from.length : i];
    }));
    here.sort((a, b) => wanted.get(a.id)! - wanted.get(b.id)!);
    let next = -Infinity;
    for (const { id } of here) {
      const row = Math.max(wanted.get(id)!, next);
      next = row + 1;
      rows.set(id, row);
      places.set(id, { x: k * (BOX.width + BOX.across), y: row * (BOX.height + BOX.down) });
    }
  }
  return places;
}

/** The page of what a node stands for, if there is one. */
export function pageOf(node: LineageNode): string | null {
  if (!node.exists) return null;
  const [id = "", revision] = node.id.split("@");
  if (id.startsWith("ds_")) return `/datasets/${id}`;
  if (id.startsWith("sys_")) return revision ? `/systems/${id}/revisions?to=${revision}` : `/systems/${id}/panel`;
  if (id.startsWith("acq_")) return `/acquisitions/${id}`;
  if (id.startsWith("job_")) return `/jobs/${id}`;
  if (id.startsWith("res_")) return `/results/${id}`;
  return null;
}
