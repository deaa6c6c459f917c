/** A design that can be compared: a revision of a system, or what a job has found: the best of a search, an identified model. */
export type DesignRef = { kind: "revision"; id: string; revision: number } | { kind: "job"; id: string };

/** Of one comparison: as many as a plot can show apart. */
export const MOST_DESIGNS = 12;

/** As in an address: `sys_...@3`, `job_...`. */
export function designText(ref: DesignRef): string {
  return ref.kind === "revision" ? `${ref.id}@${ref.revision}` : ref.id;
}

/** The designs that an address names, each once; what names none is left out. */
export function readDesigns(query: URLSearchParams): DesignRef[] {
  return [...new Set(query.getAll("d"))].flatMap(readDesign).slice(0, MOST_DESIGNS);
}

function readDesign(text: string): DesignRef[] {
  const [, system, revision] = /^(sys_\w+)@([1-9]\d*)$/.exec(text) ?? [];
  if (system) return [{ kind: "revision", id: system, revision: Number(revision) }];
  return /^job_\w+$/.test(text) ? [{ kind: "job", id: text }] : [];
}

/** The address of a comparison. */
export function compareAt(refs: readonly DesignRef[]): string {
  return `/compare?${new URLSearchParams(refs.map((ref) => ["d", designText(ref)])).toString()}`;
}
