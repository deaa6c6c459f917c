import type { Block, ElementEntry, ParameterDocument, ParameterEntry, Scalar, SystemDocument } from "@/shared/api/types";
import { readEntry } from "@/shared/units/number";
import { blockOf, connectionsOf, endOf, freeName, isTaken, NAME, portsOf, textOf, type Catalogue, type End } from "./model";
import { readList } from "./ValueEntry";

/** Diagrams by typing: `controller: pi kp=35 ki=100` adds a block, `velocity > tachometer` a connection, `speed: velocity` an output. */

export interface Typed {
  name: string | undefined;
  /** What is left to find a kind by. */
  kind: string;
  values: Record<string, string>;
}

/** A value goes on to the next `name =`, so that `12 mm` and `1, 0.5` need no quotes; `=kp/2` behind the sign is an expression. */
const VALUES = /(?:^|\s)([A-Za-z_]\w*)\s*=\s*(.*?)(?=\s+[A-Za-z_]\w*\s*=|$)/g;

export function readTyped(text: string): Typed {
  const values: Record<string, string> = {};
  const rest = text.replace(VALUES, (_, key: string, value: string) => {
    values[key] = value.trim();
    return " ";
  });
  const [, name, kind] = /^\s*(?:([^:]*):)?(.*)$/s.exec(rest)!;
  return { name: name?.trim() || undefined, kind: (kind ?? "").trim(), values };
}

/** The entries that the words could mean, the likeliest first: the kind itself, its beginning, the beginning of a word, anywhere. */
export function kindsLike(words: string, catalogue: Catalogue): ElementEntry[] {
  const wanted = words.toLowerCase().replaceAll("_", " ").trim();
  const rank = (entry: ElementEntry): number => {
    const kind = entry.kind.replaceAll("_", " ");
    const all = `${kind} ${entry.title.toLowerCase()}`;
    if (kind === wanted) return 0;
    if (kind.startsWith(wanted)) return 1;
    if (all.includes(` ${wanted}`)) return 2;
    if (all.includes(wanted)) return 3;
    return wanted.split(/\s+/).every((word) => all.includes(word)) ? 4 : 9;
  };
  return [...catalogue.values()]
    .map((entry) => ({ entry, rank: rank(entry) }))
    .filter(({ rank: found }) => found < 9)
    .sort((a, b) => a.rank - b.rank || a.entry.kind.length - b.entry.kind.length)
    .map(({ entry }) => entry);
}

export type Refusal = { key: string; place?: string; rule: "name" | "taken" | "parameter" | "value" };

/** The block that was typed, under its own name or the next free one, or what is wrong with it. */
export function blockTyped(typed: Typed, entry: ElementEntry, document: SystemDocument): { name: string; block: Block } | Refusal {
  if (typed.name !== undefined && !NAME.test(typed.name)) return { key: typed.name, rule: "name" };
  if (typed.name !== undefined && isTaken(typed.name, Object.keys(document.blocks))) return { key: typed.name, rule: "taken" };
  const block = blockOf(entry);
  const known = new Map((entry.parameters as ParameterEntry[]).map((parameter) => [parameter.name, parameter]));
  for (const [key, text] of Object.entries(typed.values)) {
    const parameter = known.get(key);
    if (!parameter) return { key, place: entry.kind, rule: "parameter" };
    const value = valueTyped(parameter, text);
    if (value === undefined) return { key, rule: "value" };
    block[key] = value;
  }
  // The example's optional values would contradict what was typed, or add what nobody asked for.
  if (Object.keys(typed.values).length > 0) {
    for (const key of Object.keys(block)) if (known.has(key) && !(key in typed.values) && !(known.get(key) as { required?: boolean }).required) delete block[key];
  }
  return { name: typed.name ?? freeName(entry.kind, Object.keys(document.blocks)), block };
}

/** A value as its parameter wants it: text, a list, or a number with prefix, unit or expression. */
export function valueTyped(parameter: ParameterEntry & { shape?: string }, text: string): unknown {
  if (text === "") return undefined;
  if (parameter.shape === "text" || parameter.choices?.length) return text;
  if (parameter.shape !== undefined && parameter.shape !== "scalar" && parameter.shape !== "integer") return readList(text);
  return scalarTyped(text, parameter.unit);
}

export function scalarTyped(text: string, unit = ""): Scalar | undefined {
  const read = readEntry(text, unit);
  if (read.kind === "wrong") return undefined;
  return read.kind === "number" ? read.value : read.kind === "quantity" ? { value: read.value, unit: read.unit } : read.text;
}

export interface Wire {
  from: End;
  to: End;
  label: string;
  /** What the input gets now. */
  instead: string | undefined;
}

/** Every connection that could begin at a block, free inputs first. */
export function wiresFrom(name: string, document: SystemDocument, catalogue: Catalogue): Wire[] {
  const block = document.blocks[name];
  if (!block) return [];
  const taken = new Map(
    connectionsOf(document).map((wire) => {
      const end = endOf(wire.to, document, catalogue, "inputs");
      return [`${end.block}.${end.port}`, wire.from];
    }),
  );
  const outputs = portsOf(block, catalogue).outputs;
  const found: Wire[] = [];
  for (const port of outputs) {
    for (const [other, target] of Object.entries(document.blocks)) {
      for (const input of portsOf(target, catalogue).inputs) {
        const to = { block: other, port: input };
        const label = textOf(to, document, catalogue, "inputs");
        found.push({ from: { block: name, port }, to, label: outputs.length === 1 ? label : `${port} → ${label}`, instead: taken.get(`${other}.${input}`) });
      }
    }
  }
  return found.sort((a, b) => Number(a.instead !== undefined) - Number(b.instead !== undefined));
}

/** Labels that hold every word that was typed; those made of just these words come first. */
export function matching<T>(items: readonly T[], label: (item: T) => string, text: string): T[] {
  const wanted = parts(text);
  const rank = (item: T): number => {
    const own = parts(label(item));
    if (!wanted.every((word) => own.some((part) => part.includes(word)))) return 9;
    return wanted.filter((word) => !own.includes(word)).length + (own.length === wanted.length ? 0 : 0.5);
  };
  return items
    .map((item, i) => ({ item, i, rank: rank(item) }))
    .filter((found) => found.rank < 9)
    .sort((a, b) => a.rank - b.rank || a.i - b.i)
    .map((found) => found.item);
}

const parts = (text: string): string[] => text.toLowerCase().split(/\s*(?:->|→|>|\s)\s*/).filter(Boolean);

/** `area = 20 cm**2 [10, 50]`: name, value in a unit or as an expression, bounds in the same unit. A name alone is worth 1. */
export function readParameter(text: string): { name: string; parameter: ParameterDocument | undefined } {
  const [, name = "", rest] = /^\s*([^=\s]*)\s*(?:=(.*))?$/s.exec(text) ?? [];
  if (rest === undefined) return { name, parameter: name === "" ? undefined : { value: 1 } };
  const [, value = "", lower, upper] = /^(.*?)(?:\[([^,\]]*),([^\]]*)\])?\s*$/s.exec(rest)!;
  const trimmed = value.trim();
  // What is no number is an expression: `kd = kp/20` needs no second sign.
  const found = scalarTyped(trimmed) ?? (/[A-Za-z_(]/.test(trimmed) ? scalarTyped(`=${trimmed}`) : undefined);
  if (found === undefined) return { name, parameter: undefined };
  const parameter: ParameterDocument = typeof found === "object" ? { value: found.value, unit: found.unit } : { value: found };
  for (const [key, bound] of [["lower", lower], ["upper", upper]] as const) {
    if (bound === undefined || bound.trim() === "") continue;
    const read = scalarTyped(bound, parameter.unit);
    if (read === undefined) return { name, parameter: undefined };
    parameter[key] = read;
  }
  return { name, parameter };
}
