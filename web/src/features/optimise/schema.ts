import { z } from "zod";
import { readScenarios } from "@/shared/systems/scenarios";
import { readCurve } from "./curves";
import { readParts, readRanges } from "./structures";

const scalar = z.union([z.number(), z.string(), z.object({ value: z.number(), unit: z.string() })]);
const maybe = scalar.optional();
const scale = z.enum(["linear", "log"]).optional();

/** How a parameter is chosen: within a range, in whole numbers, out of a list, or by an expression of others. */
export const CHOSEN = ["range", "whole", "list", "tied"] as const;

/** The form of a search as it stands in an address; messages are keys of translations. */
export const shape = z.object({
  experiments: z.array(z.object({ name: z.string(), commands: z.array(z.object({ port: z.string(), signal: z.looseObject({ kind: z.string() }) })), duration: maybe })),
  variables: z.array(z.object({ parameter: z.string(), chosen: z.enum(CHOSEN), lower: maybe, upper: maybe, scale, start: maybe, choices: z.array(scalar).optional(), expression: z.string().optional() })),
  goals: z.array(
    z.object({
      metric: z.string(),
      /** Of a metric of time: its output, and its experiment or, where none is named, every one. Of a path: its end. */
      output: z.string(),
      experiment: z.string(),
      /** Where a path begins; where a loop is opened. */
      from: z.string(),
      loop: z.string(),
      sense: z.enum(["", "minimize", "maximize"]),
      lower: maybe,
      upper: maybe,
      target: maybe,
      tolerance: maybe,
      soft: z.boolean(),
      weight: z.number().optional(),
      /** Whether a value of an output that has not settled is none. */
      settled: z.boolean().optional(),
      /** What a whole curve is held against, as it is written. */
      upperCurve: z.string().optional(),
      lowerCurve: z.string().optional(),
      curveScale: maybe,
      reference: z.string().optional(),
      band: z.array(maybe).optional(),
      /** The number that its metric takes: see `numberOf`. */
      number: maybe,
    }),
  ),
  scenarios: z.string(),
  across: z.enum(["worst", "mean"]),
  uncertain: z.array(z.object({ parameter: z.string(), lower: maybe, upper: maybe, scale })),
  draws: z.number().optional(),
  /** What this system is compared with: other stored systems, and, without an `id`, itself with other parts. */
  structures: z.array(z.object({ id: z.string(), name: z.string(), removed: z.array(z.string()).optional(), added: z.string().optional(), ranges: z.string().optional() })),
  method: z.string(),
  options: z.record(z.string(), z.union([z.number(), z.string(), z.array(z.number())])),
  others: z.array(z.string()),
  priority: z.enum(["high", "normal", "low"]),
  limit: z.number().optional(),
  /** An instant, ISO 8601. */
  deadline: z.string().optional(),
});

export type Search = z.infer<typeof shape>;
export type Variable = Search["variables"][number];
export type Goal = Search["goals"][number];
export type Experiment = Search["experiments"][number];
export type Structure = Search["structures"][number];
export type Signal = Experiment["commands"][number]["signal"];

/** What a metric is held against besides bounds. */
export function needsOf(metric: string): "" | "band" | "reference" | "envelope" | "magnitude" {
  if (metric === "band_energy") return "band";
  if (metric === "tracking_error") return "reference";
  if (metric === "envelope") return "envelope";
  return metric.endsWith("_bound") ? "magnitude" : "";
}

/** The field of the number that a metric takes, with its unit: "" is that of the output. */
export function numberOf(metric: string): { field: "settling_band" | "recovery_band" | "noise_density" | "derivative"; unit: string; needed: boolean; example?: string } | undefined {
  if (metric === "settling_time") return { field: "settling_band", unit: "1", needed: false, example: "2 %" };
  if (metric === "recovery_time") return { field: "recovery_band", unit: "", needed: true };
  if (["max_velocity", "max_acceleration", "control_effort"].includes(metric)) return { field: "derivative", unit: "1", needed: false, example: "0, 1, 2" };
  return metric === "noise_rms" ? { field: "noise_density", unit: "1", needed: true } : undefined;
}

const above = (lower: unknown, upper: unknown, same = false) => typeof lower === "number" && typeof upper === "number" && (same ? lower > upper : lower >= upper);

/** What can be told before the service is asked. */
export const search = shape.superRefine((form, context) => {
  const wrong = (path: (string | number)[], message: string) => context.addIssue({ code: "custom", path, message });
  form.experiments.forEach(({ name }, i) => {
    if (name.trim() === "") wrong(["experiments", i, "name"], "optimise.unnamed");
    else if (form.experiments.findIndex((other) => other.name === name) < i) wrong(["experiments", i, "name"], "optimise.twice");
  });
  form.variables.forEach(({ parameter, chosen, lower, upper, choices, expression }, i) => {
    if (form.variables.findIndex((other) => other.parameter === parameter) < i) wrong(["variables", i, "parameter"], "optimise.twice");
    if (chosen === "list" && !choices?.length) wrong(["variables", i, "choices"], "optimise.noChoices");
    if (chosen === "tied" && !/^=\s*\S/.test(expression ?? "")) wrong(["variables", i, "expression"], "optimise.noExpression");
    if ((chosen === "range" || chosen === "whole") && above(lower, upper)) wrong(["variables", i, "upper"], "optimise.order");
  });
  form.goals.forEach((goal, i) => {
    const { metric, sense, lower, upper, target, tolerance, soft, weight, upperCurve, lowerCurve, reference, band } = goal;
    const needs = needsOf(metric);
    const bounded = lower !== undefined || upper !== undefined || target !== undefined || needs === "envelope" || needs === "magnitude";
    if (sense === "" && !bounded) wrong(["goals", i, "sense"], "optimise.nothing");
    if (above(lower, upper, true)) wrong(["goals", i, "upper"], "optimise.order");
    if (target !== undefined && (lower !== undefined || upper !== undefined)) wrong(["goals", i, "target"], "optimise.targetAlone");
    if (target === undefined && tolerance !== undefined) wrong(["goals", i, "tolerance"], "optimise.toleranceAlone");
    if (target === 0 && tolerance === undefined) wrong(["goals", i, "tolerance"], "optimise.toleranceOfZero");
    if (soft && !bounded) wrong(["goals", i, "soft"], "optimise.softWithout");
    if (weight !== undefined && !(weight > 0)) wrong(["goals", i, "weight"], "optimise.weightSign");
    if (needs === "band" && (band?.[0] === undefined || band[1] === undefined)) wrong(["goals", i, "band"], "optimise.noBand");
    if (numberOf(metric)?.needed && goal.number === undefined) wrong(["goals", i, "number"], "optimise.noNumber");
    if (needs === "reference" && readCurve(reference ?? "", "time") === undefined) wrong(["goals", i, "reference"], "optimise.noCurve");
    if (needs === "envelope" || needs === "magnitude") {
      if (!upperCurve?.trim() && !lowerCurve?.trim()) wrong(["goals", i, "upperCurve"], "optimise.noCurve");
      for (const [key, text] of Object.entries({ upperCurve, lowerCurve })) if (text?.trim() && readCurve(text, needs === "envelope" ? "time" : "frequency") === undefined) wrong(["goals", i, key], "optimise.noCurve");
    }
  });
  form.uncertain.forEach(({ lower, upper }, i) => {
    if (lower === undefined) wrong(["uncertain", i, "lower"], "optimise.bothEnds");
    if (upper === undefined) wrong(["uncertain", i, "upper"], "optimise.bothEnds");
    if (above(lower, upper)) wrong(["uncertain", i, "upper"], "optimise.order");
  });
  form.structures.forEach(({ id, name, added, ranges }, i) => {
    if (id !== "") return;
    if (name.trim() === "") wrong(["structures", i, "name"], "optimise.unnamed");
    else if (form.structures.findIndex((other) => other.name === name) < i) wrong(["structures", i, "name"], "optimise.twice");
    if (added?.trim() && readParts(added) === undefined) wrong(["structures", i, "added"], "optimise.noParts");
    if (ranges?.trim() && readRanges(ranges) === undefined) wrong(["structures", i, "ranges"], "optimise.noRanges");
  });
  if (readScenarios(form.scenarios) === undefined) wrong(["scenarios"], "optimise.badScenario");
});

const OF_VARIABLE = new Set(["parameter", "lower", "upper", "scale", "start", "choices", "expression"]);
const OF_GOAL: Record<string, string> = { experiment: "experiment", output: "output", from: "from", to: "output", open_at: "loop", sense: "sense", lower: "lower", upper: "upper", target: "target", tolerance: "tolerance", hard: "soft", accept: "settled", weight: "weight", band: "band", reference: "reference", bounds: "upperCurve", settling_band: "number", recovery_band: "number", noise_density: "number", derivative: "number" };
const WHOLE: Record<string, string> = { scenarios: "scenarios", yield_samples: "draws", cross_check: "others", alternatives: "structures", across_scenarios: "across" };

/** The field of the form that a place of the request belongs to; null for places that have none. `rows`: the row of each of its goals. */
export function fieldOf(pointer: string, rows: readonly number[] = []): string | null {
  const [first = "", second = "", third = "", fourth = "", ...rest] = pointer.split("/").slice(1);
  if (first === "variables") return `variables.${second}.${OF_VARIABLE.has(third) ? third : third === "integer" ? "lower" : "parameter"}`;
  if (first === "goals" && second !== "") {
    const row = `goals.${rows[Number(second)] ?? second}`;
    if (third === "bounds" && (fourth === "lower" || fourth === "scale")) return `${row}.${fourth === "lower" ? "lowerCurve" : "curveScale"}`;
    return `${row}.${OF_GOAL[third] ?? "metric"}`;
  }
  if (first === "experiments" && second !== "") {
    if (third !== "input") return `experiments.${second}.${third === "duration" ? "duration" : "name"}`;
    // One command is said by itself, several in a list.
    const [command, ...inside] = /^\d+$/.test(fourth) ? [fourth, ...rest] : ["0", ...(fourth === "" ? [] : [fourth]), ...rest];
    // The unit of a quantity and the point of a list are shown in the field of the whole.
    const field = inside.filter((part) => !/^(\d+|unit|value)$/.test(part)).join(".") || "port";
    return `experiments.${second}.commands.${command}.${field}`.replace(/\.(signal|command)$/, ".$1.kind");
  }
  if (first === "uncertain" && second !== "") return `uncertain.${second}.${third === "lower" || third === "upper" ? third : "parameter"}`;
  // The first is this system itself.
  if (first === "alternatives" && Number(second) > 0) return `structures.${Number(second) - 1}.${{ add: "added", remove: "removed", variables: "ranges" }[third] ?? "name"}`;
  if (first === "method") return second === "" || second === "kind" ? "method" : `options.${second}`;
  if (first === "queue") return second === "time_limit" ? "limit" : second === "deadline" ? "deadline" : "priority";
  return WHOLE[first] ?? null;
}
