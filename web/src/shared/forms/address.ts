import type { z } from "zod";

/** What each field of a form may hold: the shape of its schema. */
export type Shape<Fields> = { [Key in keyof Fields]-?: z.ZodType };

/** Parameters of an address; those that are null stand in it no more. */
export type Parameters = Record<string, string | null>;

/** A fault of what a value is, and not merely of how large it is: no form could show it. */
const ALIEN = new Set(["invalid_type", "invalid_value", "invalid_union"]);

/**
 * Parameters for the fields that differ from what the form begins with: text as it is, everything else as JSON, an entry that was
 * emptied as nothing. An address stays short, and a form that begins otherwise tomorrow still shows what was changed in it.
 */
export function writeFields<Fields extends object>(fields: Fields, begin: Fields, prefix = ""): Parameters {
  const keys = new Set([...Object.keys(begin), ...Object.keys(fields)]) as Set<keyof Fields & string>;
  return Object.fromEntries([...keys].map((key) => [prefix + key, text(fields[key]) === text(begin[key]) ? null : text(fields[key])]));
}

function text(value: unknown): string {
  if (typeof value === "string") return value;
  return value === undefined || Number.isNaN(value) ? "" : JSON.stringify(value);
}

/** The fields of a form as an address holds them; what the address does not say, or says in a way that no form could show, is as the form begins. */
export function readFields<Fields extends object>(query: URLSearchParams, begin: Fields, shape: Shape<Fields>, prefix = ""): Fields {
  const found = { ...begin };
  for (const key of Object.keys(shape) as (keyof Fields & string)[]) {
    const given = query.get(prefix + key);
    if (given !== null) found[key] = understood(given, begin[key], shape[key]);
  }
  return found;
}

function understood<Value>(given: string, begin: Value, schema: z.ZodType): Value {
  let value: unknown = given;
  if (typeof begin !== "string") {
    // An empty entry: nothing where nothing may be said, otherwise no number, which the form refuses.
    if (given === "") return (schema.safeParse(undefined).success ? undefined : NaN) as Value;
    try {
      value = JSON.parse(given);
    } catch {
      return begin;
    }
  }
  const told = schema.safeParse(value);
  // What is only too large is shown, and refused at its field.
  return told.success || told.error.issues.every(({ code }) => !ALIEN.has(code)) ? (value as Value) : begin;
}

/** An address with some of its parameters changed; the same one where nothing was. */
export function withParameters(query: URLSearchParams, parameters: Parameters): URLSearchParams {
  const next = new URLSearchParams(query);
  for (const [key, value] of Object.entries(parameters)) {
    if (value === null) next.delete(key);
    else if (next.get(key) !== value) next.set(key, value);
  }
  return next.toString() === query.toString() ? query : next;
}
