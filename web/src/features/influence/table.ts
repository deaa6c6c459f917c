/** How strongly a cell is coloured: by the root, so that small influences are still seen beside large ones. */
export function sizeOf(value: number, largest: number): number {
  return Number.isFinite(value) && largest > 0 ? Math.sqrt(Math.min(1, Math.abs(value) / largest)) : 0;
}

/** The bars of one metric, longest first; what has no value has no bar. */
export function tornado(cells: { name: string; value: number | null }[]): { name: string; value: number }[] {
  return cells.flatMap(({ name, value }) => (value === null ? [] : [{ name, value }])).sort((a, b) => Math.abs(b.value) - Math.abs(a.value));
}

/** What the bars show: all parameters of one metric, or all metrics of one parameter. */
export function barsOf(value: (metric: string, parameter: string) => number | null, { metrics, parameters, row, column }: { metrics: string[]; parameters: string[]; row: string; column: string | null }) {
  return tornado(column === null ? parameters.map((name) => ({ name, value: value(row, name) })) : metrics.map((name) => ({ name, value: value(name, column) })));
}

/** The column that an address reads, if the table has it. */
export function columnIn(text: string | null, parameters: string[]): string | null {
  return text !== null && parameters.includes(text) ? text : null;
}

/** The finite change of an address in per cent: as far as the slider goes, and not 0. */
export function changeIn(text: string | null): number {
  const change = Math.round(Number(text ?? NaN));
  return Number.isFinite(change) && change !== 0 && Math.abs(change) <= 50 ? change : 10;
}

/** Elasticities and coefficients of this size are rounding, not influence: sizes of 1 are what the table is about. */
const ROUNDING = 1e-9;

/** A number of the table: what lies below rounding is 0. */
export function beyondRounding(value: number): number {
  return Math.abs(value) < ROUNDING ? 0 : value;
}
