import { zodResolver } from "@hookform/resolvers/zod";
import type { Resolver } from "react-hook-form";
import { z } from "zod";
import type { Scalar } from "@/shared/api/types";
import { readEntry } from "@/shared/units/number";

export const ESTIMATORS = ["H1", "H2", "Hv", "multisine", "stepped_sine"] as const;
/** Of a file that holds measured responses: they are taken as they are. */
export const MEASURED = "measured";
export const FORMS = ["", "receptance", "mobility", "accelerance"] as const;
export const WINDOWS = ["hann", "flat_top", "none"] as const;

/** Frequencies with semicolons between them, rad/s unless they say otherwise: `5 Hz; 10 Hz`; undefined where one cannot be read. */
export function readFrequencies(text: string): Scalar[] | undefined {
  const entries = text.split(";").filter((part) => part.trim() !== "").map((part) => readEntry(part, "rad/s"));
  const found = entries.flatMap((entry): Scalar[] => (entry.kind === "number" ? [entry.value] : entry.kind === "quantity" ? [{ value: entry.value, unit: entry.unit }] : []));
  return found.length === entries.length && found.length > 0 ? found : undefined;
}

const notNegative = z.number("forms.number").min(0, "forms.notNegative").optional();
const optional = z.number("forms.number").positive("forms.positive").optional();
export const frfSchema = z
  .object({
    input: z.string().min(1, "forms.required"),
    outputs: z.array(z.string()).min(1, "spectra.needOutput"),
    estimator: z.enum([...ESTIMATORS, MEASURED]),
    segment: optional,
    window: z.enum(WINDOWS),
    confidence: z.number("forms.number").gt(0.5, "spectra.confidenceWrong").lt(1, "spectra.confidenceWrong"),
    form: z.enum(FORMS),
    period: optional,
    modes: z.boolean(),
    /** Of stepped sines: one frequency after the other, each for the same time. */
    frequencies: z.string(),
    dwell: optional,
    begin: notNegative,
    settle: notNegative,
    /** A model to be held against the measurement. */
    system: z.string(),
    from: z.string(),
    to: z.string(),
  })
  .refine(({ estimator, input, outputs }) => estimator === MEASURED || !outputs.includes(input), { path: ["outputs"], message: "spectra.itself" })
  .refine(({ estimator, period }) => estimator !== "multisine" || period !== undefined, { path: ["period"], message: "forms.required" })
  .refine(({ estimator, dwell }) => estimator !== "stepped_sine" || dwell !== undefined, { path: ["dwell"], message: "forms.required" })
  .refine(({ estimator, frequencies }) => estimator !== "stepped_sine" || readFrequencies(frequencies) !== undefined, { path: ["frequencies"], message: "spectra.frequenciesWrong" })
  .refine(({ system, from }) => system === "" || from !== "", { path: ["from"], message: "forms.required" })
  .refine(({ system, to }) => system === "" || to !== "", { path: ["to"], message: "forms.required" });
export type FrfFields = z.infer<typeof frfSchema>;

/** Judges what can be seen: a number that was left wrong in a field of another estimator would hold the form back without a word. */
export const frfResolver: Resolver<FrfFields> = (fields, ...rest) => {
  const { estimator, system } = fields;
  const hidden = {
    ...(estimator !== "multisine" ? { period: undefined } : {}),
    ...(estimator !== "stepped_sine" ? { frequencies: "", dwell: undefined, begin: undefined } : {}),
    ...(isPeriodic(fields) ? { segment: undefined } : { settle: undefined }),
    ...(system === "" ? { from: "", to: "" } : {}),
  };
  return zodResolver(frfSchema)({ ...fields, ...hidden }, ...rest);
};

/** What can be chosen: channels for both, or the points of measured responses. */
export interface Points {
  inputs: string[];
  outputs: string[];
}

/** The points between which a file holds measured responses. */
export function measuredPoints(functions: { kind: string; response: string; reference: string }[]): Points {
  const responses = functions.filter(({ kind }) => kind === "frequency response" || kind === "transmissibility");
  return { inputs: [...new Set(responses.map(({ reference }) => reference))], outputs: [...new Set(responses.map(({ response }) => response))] };
}

/** The form as the address holds it. */
export function readFrf(query: URLSearchParams, channels: string[], measured?: Points): FrfFields {
  const { inputs, outputs: there } = measured ?? { inputs: channels, outputs: channels };
  const number = (key: string) => (query.get(key) ? Number(query.get(key)) : undefined);
  const one = <T extends string>(key: string, all: readonly T[]): T => all.find((value) => value === query.get(key)) ?? all[0]!;
  // One by one, so that a channel's name may hold a comma; links of before had them all in one.
  const outputs = query.getAll("outputs").flatMap((given) => (there.includes(given) ? [given] : given.split(",").filter((name) => there.includes(name))));
  return {
    input: inputs.find((name) => name === query.get("input")) ?? inputs[0] ?? "",
    outputs: outputs.length > 0 ? outputs : measured ? there.slice(0, 1) : channels.slice(1, 2),
    estimator: measured ? MEASURED : one("estimator", ESTIMATORS),
    segment: number("segment"),
    window: one("window", WINDOWS),
    confidence: number("confidence") ?? 0.95,
    form: one("form", FORMS),
    period: number("period"),
    modes: query.get("modes") === "1",
    frequencies: query.get("frequencies") ?? "",
    dwell: number("dwell"),
    begin: number("begin"),
    settle: number("settle"),
    system: query.get("system") ?? "",
    from: query.get("from") ?? "",
    to: query.get("to") ?? "",
  };
}

export function writeFrf(fields: FrfFields): URLSearchParams {
  const query = new URLSearchParams({ input: fields.input, estimator: fields.estimator, window: fields.window, confidence: String(fields.confidence) });
  for (const output of fields.outputs) query.append("outputs", output);
  if (fields.segment !== undefined) query.set("segment", String(fields.segment));
  if (fields.period !== undefined && fields.estimator === "multisine") query.set("period", String(fields.period));
  for (const key of ["dwell", "begin"] as const) if (fields[key] !== undefined && fields.estimator === "stepped_sine") query.set(key, String(fields[key]));
  if (fields.estimator === "stepped_sine") query.set("frequencies", fields.frequencies);
  if (fields.settle !== undefined && isPeriodic(fields)) query.set("settle", String(fields.settle));
  if (fields.system) for (const key of ["system", "from", "to"] as const) query.set(key, fields[key]);
  if (fields.form) query.set("form", fields.form);
  if (fields.modes) query.set("modes", "1");
  return query;
}

/** Whether whole periods are fitted, which need neither segments nor a window. */
export function isPeriodic({ estimator }: Pick<FrfFields, "estimator">): boolean {
  return estimator === "multisine" || estimator === "stepped_sine";
}

/** Stepped sines one after the other. */
function stepsOf({ frequencies, dwell = 0, begin = 0 }: FrfFields) {
  return (readFrequencies(frequencies) ?? []).map((frequency, i) => ({ frequency, start: begin + i * dwell, end: begin + (i + 1) * dwell }));
}

/** How lines come about from samples, and the bounds on them. */
function averaging(fields: FrfFields): Record<string, unknown> {
  const settle = fields.settle !== undefined ? { settle: fields.settle } : {};
  return { ...(isPeriodic(fields) ? settle : { window: fields.window, ...(fields.segment !== undefined ? { segment: fields.segment } : {}) }), confidence: fields.confidence };
}

/** The request that an address stands for. */
export function frfRequest(dataset: string, fields: FrfFields): Record<string, unknown> {
  return {
    dataset,
    input: fields.input,
    output: fields.outputs,
    estimator: fields.estimator,
    ...(fields.estimator === "multisine" ? { period: fields.period } : {}),
    ...(fields.estimator === "stepped_sine" ? { steps: stepsOf(fields) } : {}),
    ...(fields.estimator === MEASURED ? {} : averaging(fields)),
    ...(fields.system ? { system: fields.system, from: fields.from, to: fields.to } : {}),
    ...(fields.form ? { form: fields.form } : {}),
    ...(fields.modes ? { modes: {} } : {}),
  };
}
