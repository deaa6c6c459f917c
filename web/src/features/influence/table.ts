/** How strongly a cell is coloured: by the root, so that small influences are still seen beside large ones. */
export function sizeOf(value: number, largest: number): number {
  return Number.isFinite(value) && largest > 0 ? Math.sqrt(Math.min(1, Math.abs(value) / largest)) : 0;
}

/** The bars of one metric, longest first; what has no value has no bar. */
export function tornado(cells: { name: string; value: number | null }[]): { name: string; value: number }[] {
  return cells.flatMap(({ name, value }) => (value === null ? [] : [{ name, value }])).sort((a, b) => Math.abs(b.value) - Math.abs(a.value));
}
