/** Forms out of the service's own contract: what a request may hold, as fields that a page can show. */

/** The part of JSON Schema that the contract uses. */
export interface Schema {
  $ref?: string;
  type?: string;
  const?: unknown;
  enum?: string[];
  anyOf?: Schema[];
  oneOf?: Schema[];
  items?: Schema;
  properties?: Record<string, Schema>;
  patternProperties?: Record<string, Schema>;
  additionalProperties?: Schema | boolean;
  required?: string[];
  default?: unknown;
  description?: string;
}
export type Schemas = Record<string, Schema>;

export type FieldKind = "number" | "integer" | "quantity" | "edges" | "window" | "integers" | "choice" | "flag" | "text" | "channel" | "channels" | "ports";
export interface Field {
  name: string;
  kind: FieldKind;
  required: boolean;
  /** What the service takes where nothing is said. */
  otherwise: unknown;
  unit: string;
  choices: string[];
  doc: string;
}

/** Strings that name one channel of a recording. */
const CHANNEL = new Set(["channel", "force", "position", "velocity", "input", "output"]);
/** The SI units of quantities, which have one meaning under one name in the whole contract. */
export const UNITS: Record<string, string> = { start: "s", end: "s", longest: "s", estimation: "s", validation: "s", largest_delay: "s", settle: "s", segment: "s", period: "s", low_pass: "rad/s", high_pass: "rad/s", frequency: "rad/s", rate: "1/s" };

const isQuantity = (schema: Schema | undefined): boolean => schema?.$ref?.endsWith("/Quantity") ?? false;

function kindOf(name: string, schema: Schema): FieldKind | null {
  if (schema.const !== undefined) return null;
  if (schema.enum) return "choice";
  if (isQuantity(schema)) return "quantity";
  if (schema.oneOf?.some(isQuantity)) return "edges";
  if (schema.type === "boolean") return "flag";
  if (schema.type === "integer" || schema.type === "number") return schema.type;
  if (schema.type === "string") return CHANNEL.has(name) ? "channel" : "text";
  if (schema.type === "object" && (schema.patternProperties ?? schema.additionalProperties)) return "ports";
  if (schema.type !== "array") return null;
  if (isQuantity(schema.items)) return "window";
  return schema.items?.type === "integer" ? "integers" : schema.items?.type === "string" ? "channels" : null;
}

/** The fields of a request, without those that the page shows in its own way. */
export function fieldsOf(schema: Schema, without: readonly string[] = []): Field[] {
  const found = Object.entries(schema.properties ?? {}).flatMap(([name, given]): Field[] => {
    // "or null" is how the contract says that something may be left out.
    const own = given.anyOf?.find((one) => one.type !== "null") ?? given;
    const kind = without.includes(name) ? null : kindOf(name, own);
    return kind === null ? [] : [{ name, kind, required: schema.required?.includes(name) ?? false, otherwise: given.default ?? undefined, unit: UNITS[name] ?? "", choices: own.enum ?? [], doc: given.description ?? own.description ?? "" }];
  });
  // What must be said comes first; the contract itself is sorted by name.
  return [...found.filter(({ required }) => required), ...found.filter(({ required }) => !required)];
}

export type Values = Record<string, unknown>;

const isEmpty = (value: unknown): boolean => value === undefined || value === "" || (Array.isArray(value) && value.length === 0) || (typeof value === "object" && value !== null && Object.keys(value).length === 0);

/** What is sent: nothing that was left empty, nothing that another kind of request had. */
export function bodyOf(fields: Field[], values: Values): Values {
  return Object.fromEntries(fields.flatMap(({ name }) => (isEmpty(values[name]) ? [] : [[name, values[name]]])));
}

/** Fields that must be filled and are not. */
export function missing(fields: Field[], values: Values): string[] {
  return fields.filter(({ name, required }) => required && isEmpty(values[name])).map(({ name }) => name);
}
