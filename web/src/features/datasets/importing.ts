import { z } from "zod";
import { readFields, writeFields, type Parameters } from "@/shared/forms/address";
import type { components } from "@/shared/api/schema";

type Schemas = components["schemas"];
export type ImportDocument = Schemas["ImportDocument"];
export type Format = NonNullable<Schemas["DatasetRequest"]["format"]>;

export const FORMATS: Format[] = ["csv", "txt", "lvm", "tdms", "mat", "hdf5", "parquet", "uff", "mdf", "wav", "mcap", "touchstone", "frd"];
/** What a worker found on looking at a file: everything there is, how it would be read, and what it noticed. */
export interface Look {
  series: { index: number; name: string; sample_count: number; unit: string; role: string }[];
  /** What the file holds over frequency, which is no channel. */
  functions?: Schemas["FunctionHead"][];
  refused: Record<string, string>;
  import: ImportDocument | null;
  /** Those of a file of several times, the one of `import` first; none where all channels have one time. */
  groups?: { name: string; sample_rate: number | null; sample_count: number | null; columns: NonNullable<ImportDocument["columns"]>; first: (number | null)[][] }[];
  channels: { name: string; unit?: string; first: (number | null)[] }[];
  sample_rate: number | null;
  /** Of a long file its beginning alone is looked at: null. */
  sample_count: number | null;
  uneven: number | null;
  start_time: string | null;
  scalars: Record<string, unknown>;
  remarks: string[];
}

const row = z.object({
  take: z.boolean(),
  index: z.number(),
  label: z.string(),
  /** Whose time it has; "" where all have one, or for what is no channel. */
  group: z.string(),
  name: z.string(),
  quantity: z.string(),
  unit: z.string(),
  scale: z.number("forms.number"),
  offset: z.number("forms.number"),
});
export const importSchema = z
  .object({
    columns: z.array(row),
    delimiter: z.string(),
    decimal: z.enum([".", ","]),
    thousands: z.enum(["", ".", ",", "'", " "]),
    comment: z.string(),
    allow_truncated: z.boolean(),
    header_lines: z.number("forms.number").int("forms.whole").min(0, "forms.notNegative"),
    missing: z.string(),
    /** Place of the instants in the file; "" where there are none. */
    time: z.string(),
    time_unit: z.string(),
    order: z.enum(["", "ymd", "mdy", "dmy"]),
    sample_rate: z.number("forms.number").positive("forms.positive").optional(),
    gaps: z.enum(["fill", "close"]),
    uneven: z.enum(["keep", "resample"]),
    uneven_rate: z.number("forms.number").positive("forms.positive").optional(),
    uneven_method: z.enum(["linear", "cubic"]),
    time_zone: z.string(),
  })
  .superRefine(({ columns, time, sample_rate, uneven, uneven_rate }, context) => {
    const taken = columns.flatMap((column, i) => (column.take ? [{ ...column, i }] : []));
    if (taken.length === 0) context.addIssue({ code: "custom", path: ["columns"], message: "importing.needChannel" });
    for (const { i, name, group, scale } of taken) {
      if (name.trim() === "") context.addIssue({ code: "custom", path: ["columns", i, "name"], message: "forms.required" });
      if (taken.filter((other) => other.name === name && other.group === group).length > 1) context.addIssue({ code: "custom", path: ["columns", i, "name"], message: "importing.twice" });
      if (scale === 0) context.addIssue({ code: "custom", path: ["columns", i, "scale"], message: "importing.notZero" });
    }
    if (time !== "" && uneven === "resample" && uneven_rate === undefined) context.addIssue({ code: "custom", path: ["uneven_rate"], message: "forms.required" });
    if (time === "" && sample_rate === undefined && columns.every(({ group }) => group === "")) context.addIssue({ code: "custom", path: ["sample_rate"], message: "importing.needRate" });
  });
export type ImportFields = z.infer<typeof importSchema>;

/** Whether a file is a text table, whose layout can be said. */
export function isTable(found: ImportDocument | null): boolean {
  return found?.delimiter != null || found?.header_lines != null;
}

/** The form of a proposal: every series of the file, those taken that the proposal takes. */
export function fieldsOf(look: Look): ImportFields {
  const proposed = look.import;
  const several = look.groups?.length ? look.groups : [{ name: "", columns: proposed?.columns ?? [] }];
  const placed = several.flatMap(({ name: group, columns }) => columns.map((column) => ({ ...column, group, place: placeOf(look, column) })));
  const time = proposed?.time ? placeOf(look, proposed.time) : undefined;
  return {
    columns: look.series.map((one) => {
      const column = placed.find((candidate) => candidate.place === one.index);
      return { take: column !== undefined, index: one.index, label: one.name, group: column?.group ?? "", name: column?.name ?? one.name, quantity: column?.quantity ?? "", unit: column?.unit ?? one.unit, scale: column?.scale ?? 1, offset: column?.offset ?? 0 };
    }),
    delimiter: proposed?.delimiter ?? ",",
    decimal: proposed?.decimal ?? ".",
    header_lines: proposed?.header_lines ?? 0,
    thousands: proposed?.thousands ?? "",
    comment: proposed?.comment ?? "",
    allow_truncated: proposed?.allow_truncated ?? false,
    missing: (proposed?.missing ?? []).filter((cell) => cell !== "").join("; "),
    time: time === undefined ? "" : String(time),
    time_unit: proposed?.time?.unit ?? "s",
    order: proposed?.time?.order ?? "",
    sample_rate: proposed?.sample_rate ?? undefined,
    gaps: proposed?.gaps ?? "fill",
    ...unevenOf(proposed?.uneven),
    time_zone: proposed?.time_zone ?? "UTC",
  };
}

function placeOf(look: Look, column: { index?: number | null; source?: string | null }): number | undefined {
  return column.index ?? look.series.find((one) => one.name === column.source)?.index;
}

function unevenOf(proposed: ImportDocument["uneven"]): Pick<ImportFields, "uneven" | "uneven_rate" | "uneven_method"> {
  if (!proposed || proposed === "keep") return { uneven: "keep", uneven_rate: undefined, uneven_method: "linear" };
  return { uneven: "resample", uneven_rate: proposed.resample.rate, uneven_method: proposed.resample.method ?? "linear" };
}

/** The groups of a file with how many of their channels there are and are taken. */
export function groupsOf(look: Look, columns: ImportFields["columns"]) {
  return (look.groups ?? []).map(({ name, sample_rate, sample_count }) => {
    const own = columns.filter((column) => column.group === name);
    return { name, sample_rate, sample_count, channels: own.length, taken: own.filter((column) => column.take).length };
  });
}

/** The columns with all channels of a group taken, or none. */
export function withGroup(columns: ImportFields["columns"], name: string, take: boolean): ImportFields["columns"] {
  return columns.map((column) => (column.group === name ? { ...column, take } : column));
}

/** The first samples of a series as the file has them, where the look at it has read some. */
export function firstOf(look: Look, index: number): (number | null)[] {
  const several = look.groups?.length ? look.groups : [{ columns: look.import?.columns ?? [], first: look.channels.map((channel) => channel.first) }];
  for (const { columns, first } of several) {
    const at = columns.findIndex((column) => placeOf(look, column) === index);
    if (at >= 0) return first[at] ?? [];
  }
  return [];
}

/** What was changed in a proposal, as parameters of an address: `delimiter=;`, and of the column at a place in the file `2.unit=kN`. */
export function writeDraft({ columns, ...layout }: ImportFields, { columns: proposed, ...begin }: ImportFields): Parameters {
  return Object.assign(writeFields(layout, begin), ...columns.map((column, i) => writeFields(column, proposed[i] ?? column, `${column.index}.`))) as Parameters;
}

export function readDraft(query: URLSearchParams, { columns, ...begin }: ImportFields): ImportFields {
  const { columns: _, ...layout } = importSchema.shape;
  return { ...readFields(query, begin, layout), columns: columns.map((column) => readFields(query, column, row.shape, `${column.index}.`)) };
}

/** What the form says, as the service takes it. */
export function importOf(fields: ImportFields, table: boolean): ImportDocument {
  // An empty cell is always a missing sample.
  const missing = ["", ...fields.missing.split(";").map((cell) => cell.trim()).filter((cell) => cell !== "")];
  // What is said of the time is about the first group: without it the others tell their own.
  const main = fields.columns.find(({ group }) => group !== "")?.group ?? "";
  const timed = main === "" || fields.columns.some(({ take, group }) => take && group === main);
  const uneven = fields.uneven === "keep" ? fields.uneven : { resample: { rate: fields.uneven_rate, method: fields.uneven_method } };
  return {
    ...(table ? { delimiter: fields.delimiter, decimal: fields.decimal, thousands: fields.thousands, comment: fields.comment, header_lines: fields.header_lines, missing, allow_truncated: fields.allow_truncated } : {}),
    columns: fields.columns.filter((column) => column.take).map(({ index, name, quantity, unit, scale, offset }) => ({ index, name, quantity, unit, scale, offset })),
    ...(timed && fields.time !== "" ? { time: { index: Number(fields.time), ...(fields.time_unit ? { unit: fields.time_unit } : {}), ...(fields.order ? { order: fields.order } : {}) } } : {}),
    ...(timed && fields.sample_rate !== undefined ? { sample_rate: fields.sample_rate } : {}),
    gaps: fields.gaps,
    ...(fields.time !== "" ? { uneven } : {}),
    time_zone: fields.time_zone,
  } as ImportDocument;
}

/** The layout alone: what is looked at anew when the file was read wrongly. */
export function layoutOf(fields: ImportFields): ImportDocument {
  const { columns: _, ...layout } = importOf({ ...fields, time: "", sample_rate: undefined }, true);
  return layout as ImportDocument;
}
