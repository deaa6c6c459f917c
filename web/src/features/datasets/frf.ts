import { z } from "zod";

export const ESTIMATORS = ["H1", "H2", "Hv", "multisine"] as const;
export const FORMS = ["", "receptance", "mobility", "accelerance"] as const;
export const WINDOWS = ["hann", "flat_top", "none"] as const;

const optional = z.number("forms.number").positive("forms.positive").optional();
export const frfSchema = z
  .object({
    input: z.string().min(1, "forms.required"),
    outputs: z.array(z.string()).min(1, "spectra.needOutput"),
    estimator: z.enum(ESTIMATORS),
    segment: optional,
    window: z.enum(WINDOWS),
    confidence: z.number("forms.number").gt(0.5, "spectra.confidenceWrong").lt(1, "spectra.confidenceWrong"),
    form: z.enum(FORMS),
    period: optional,
    modes: z.boolean(),
  })
  .refine(({ input, outputs }) => !outputs.includes(input), { path: ["outputs"], message: "spectra.itself" })
  .refine(({ estimator, period }) => estimator !== "multisine" || period !== undefined, { path: ["period"], message: "forms.required" });
export type FrfFields = z.infer<typeof frfSchema>;

/** The form as the address holds it. */
export function readFrf(query: URLSearchParams, channels: string[]): FrfFields {
  const number = (key: string) => (query.get(key) ? Number(query.get(key)) : undefined);
  const one = <T extends string>(key: string, all: readonly T[]): T => all.find((value) => value === query.get(key)) ?? all[0]!;
  const outputs = (query.get("outputs") ?? "").split(",").filter((name) => channels.includes(name));
  return {
    input: channels.find((name) => name === query.get("input")) ?? channels[0] ?? "",
    outputs: outputs.length > 0 ? outputs : channels.slice(1, 2),
    estimator: one("estimator", ESTIMATORS),
    segment: number("segment"),
    window: one("window", WINDOWS),
    confidence: number("confidence") ?? 0.95,
    form: one("form", FORMS),
    period: number("period"),
    modes: query.get("modes") === "1",
  };
}

export function writeFrf(fields: FrfFields): URLSearchParams {
  const query = new URLSearchParams({ input: fields.input, outputs: fields.outputs.join(","), estimator: fields.estimator, window: fields.window, confidence: String(fields.confidence) });
  if (fields.segment !== undefined) query.set("segment", String(fields.segment));
  if (fields.period !== undefined && fields.estimator === "multisine") query.set("period", String(fields.period));
  if (fields.form) query.set("form", fields.form);
  if (fields.modes) query.set("modes", "1");
  return query;
}

/** The request that an address stands for. */
export function frfRequest(dataset: string, fields: FrfFields): Record<string, unknown> {
  return {
    dataset,
    input: fields.input,
    output: fields.outputs,
    estimator: fields.estimator,
    // Whole periods need no window, and have no segments.
    ...(fields.estimator === "multisine" ? { period: fields.period } : { window: fields.window, ...(fields.segment !== undefined ? { segment: fields.segment } : {}) }),
    confidence: fields.confidence,
    ...(fields.form ? { form: fields.form } : {}),
    ...(fields.modes ? { modes: {} } : {}),
  };
}
