/** Numbers as people write them: `2.4k`, `330 m`, `1,5`, `65 cm**2`. */

const PREFIXES: Record<string, number> = { T: 1e12, G: 1e9, M: 1e6, k: 1e3, m: 1e-3, u: 1e-6, µ: 1e-6, n: 1e-9, p: 1e-12 };
/** `1,000` is a thousand to some and one to others; `0,125` and `1,5` are one number to everybody. */
const AMBIGUOUS = /^([+-]?[1-9]\d{0,2}),(\d{3})$/;
/** A decimal exponent needs a sign or a digit behind it, so that `3e` is no number. */
const FORM = /^([+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:[eE][+-]?\d+)?)\s*(.*)$/u;

export type Entry = { kind: "number"; value: number } | { kind: "quantity"; value: number; unit: string } | { kind: "expression"; text: string } | { kind: "wrong"; either?: { thousands: string; decimal: string } };

/**
 * Reads an entry for a value whose SI unit is `unit`. A lone prefix multiplies (`2.4k`, `330 m`), except that a letter which is
 * itself the unit means that unit: `5 m` of a length is five metres. Anything else behind the number is a unit, which the
 * service converts.
 */
export function readEntry(text: string, unit = ""): Entry {
  const trimmed = text.trim();
  if (trimmed.startsWith("=")) return trimmed.length > 1 ? { kind: "expression", text: trimmed } : { kind: "wrong" };
  const found = FORM.exec(trimmed);
  if (!found) return { kind: "wrong" };
  const either = AMBIGUOUS.exec(found[1]!);
  if (either) return { kind: "wrong", either: { thousands: either[1]! + either[2]!, decimal: `${either[1]}.${either[2]}` } };
  const value = Number(found[1]!.replace(",", "."));
  const rest = found[2]!.trim();
  if (!Number.isFinite(value)) return { kind: "wrong" };
  if (rest === "" || same(rest, unit)) return { kind: "number", value };
  const prefix = PREFIXES[rest];
  if (prefix !== undefined) return { kind: "number", value: times(value, prefix) };
  const scaled = PREFIXES[rest[0]!];
  if (scaled !== undefined && unit !== "" && same(rest.slice(1).trim(), unit)) return { kind: "number", value: times(value, scaled) };
  return /^[A-Za-z°%Ωµ(]/u.test(rest) ? { kind: "quantity", value, unit: rest } : { kind: "wrong" };
}

/** 330 m is 0.33, not 0.33000000000000002. */
function times(value: number, factor: number): number {
  return factor < 1 ? value / Math.round(1 / factor) : value * factor;
}

function same(written: string, unit: string): boolean {
  const plain = (text: string) => text.replaceAll("Ω", "ohm").replaceAll("·", "*").replaceAll("²", "**2").replaceAll("³", "**3").replaceAll("^", "**").replaceAll(" ", "");
  return unit !== "" && plain(written) === plain(unit);
}
