/** A grid that was computed: one axis for each variable, the first one slowest. */
export interface GridMap {
  axes: Record<string, number[]>;
  objective: (number | null)[];
  violation: (number | null)[];
}

export interface Cell {
  x: number;
  y: number;
  objective: number | null;
  met: boolean;
}

/** A violation below this is rounding. */
const MET = 1e-9;

/** Whether every goal is met at a place in the lists of a map. */
export function isMet(map: GridMap, place: number): boolean {
  return (map.violation[place] ?? Infinity) <= MET;
}

/** The plane of two variables, the others kept at the given places of their axes. */
export function sliceOf(map: GridMap, x: string, y: string, at: Record<string, number>): Cell[] {
  const names = Object.keys(map.axes);
  const strides = new Map<string, number>();
  let size = 1;
  for (const name of names.toReversed()) {
    strides.set(name, size);
    size *= map.axes[name]!.length;
  }
  const base = names.reduce((sum, name) => (name === x || name === y ? sum : sum + (at[name] ?? 0) * strides.get(name)!), 0);
  const cells: Cell[] = [];
  for (let i = 0; i < map.axes[x]!.length; i++) {
    for (let j = 0; j < map.axes[y]!.length; j++) {
      const place = base + i * strides.get(x)! + j * strides.get(y)!;
      cells.push({ x: i, y: j, objective: map.objective[place] ?? null, met: isMet(map, place) });
    }
  }
  return cells;
}

/** The values of a cell. */
export function valuesAt({ axes }: GridMap, cell: readonly number[]): Record<string, number> {
  return Object.fromEntries(Object.entries(axes).map(([name, axis], i) => [name, axis[cell[i]!]!]));
}

/** The place of a cell in the lists of a map, whose first axis is the slowest. */
export function flatOf({ axes }: GridMap, cell: readonly number[]): number {
  return Object.values(axes).reduce((place, axis, i) => place * axis.length + cell[i]!, 0);
}

/** The place of an axis that lies nearest to a value. */
export function nearest(axis: number[], value: number): number {
  let best = 0;
  for (let i = 1; i < axis.length; i++) if (Math.abs(axis[i]! - value) < Math.abs(axis[best]! - value)) best = i;
  return best;
}
