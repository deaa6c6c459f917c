/** Three versions of a document become one: what only one side changed is taken from it; where both did, mine stays and is told. */
export interface Merged<T> {
  merged: T;
  conflicts: string[];
}

export function merge<T>(base: T, mine: T, theirs: T): Merged<T> {
  const conflicts: string[] = [];
  return { merged: together("", base, mine, theirs, conflicts) as T, conflicts };
}

type Plain = Record<string, unknown>;

function together(place: string, base: unknown, mine: unknown, theirs: unknown, conflicts: string[]): unknown {
  if (same(mine, theirs) || same(base, theirs)) return mine;
  if (same(base, mine)) return theirs;
  if (place.endsWith("connections") && Array.isArray(mine) && Array.isArray(theirs)) return lists(Array.isArray(base) ? base : [], mine, theirs);
  if (isPlain(mine) && isPlain(theirs)) {
    const before = isPlain(base) ? base : {};
    const found: Plain = {};
    for (const key of new Set([...Object.keys(mine), ...Object.keys(theirs)])) {
      const value = together(place ? `${place}.${key}` : key, before[key], mine[key], theirs[key], conflicts);
      if (value !== undefined) found[key] = value;
    }
    return found;
  }
  conflicts.push(place);
  return mine;
}

/** Connections have no names: they are merged as a set. */
function lists(base: unknown[], mine: unknown[], theirs: unknown[]): unknown[] {
  const key = (item: unknown) => JSON.stringify(item);
  const had = new Set(base.map(key));
  const their = new Set(theirs.map(key));
  const own = new Set(mine.map(key));
  const kept = mine.filter((item) => !had.has(key(item)) || their.has(key(item)));
  return [...kept, ...theirs.filter((item) => !had.has(key(item)) && !own.has(key(item)))];
}

function isPlain(value: unknown): value is Plain {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

function same(a: unknown, b: unknown): boolean {
  if (a === b) return true;
  if (Array.isArray(a) && Array.isArray(b)) return a.length === b.length && a.every((item, i) => same(item, b[i]));
  if (isPlain(a) && isPlain(b)) {
    const keys = Object.keys(a);
    return keys.length === Object.keys(b).length && keys.every((key) => key in b && same(a[key], b[key]));
  }
  return false;
}
