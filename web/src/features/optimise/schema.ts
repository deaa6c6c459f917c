import { z } from "zod";
import { readScenarios } from "@/shared/systems/scenarios";

const scalar = z.union([z.number(), z.string(), z.object({ value: z.number(), unit: z.string() })]).optional();

/** The form of a search as it may stand in an address; messages are keys of translations. */
export const shape = z.object({
  input: z.string(),
  amplitude: z.number(),
  loop: z.string(),
  variables: z.array(z.object({ parameter: z.string(), lower: scalar, upper: scalar })),
  goals: z.array(z.object({ metric: z.string(), output: z.string(), sense: z.enum(["", "minimize", "maximize"]), lower: scalar, upper: scalar })),
  scenarios: z.string(),
  method: z.string(),
  options: z.record(z.string(), z.union([z.number(), z.string()])),
});

/** What can be told before the service is asked. */
export const search = shape.superRefine((form, context) => {
  const wrong = (path: (string | number)[], message: string) => context.addIssue({ code: "custom", path, message });
  form.variables.forEach(({ parameter, lower, upper }, i) => {
    if (form.variables.findIndex((other) => other.parameter === parameter) < i) wrong(["variables", i, "parameter"], "optimise.twice");
    if (typeof lower === "number" && typeof upper === "number" && lower >= upper) wrong(["variables", i, "upper"], "optimise.order");
  });
  form.goals.forEach(({ sense, lower, upper }, i) => {
    if (sense === "" && lower === undefined && upper === undefined) wrong(["goals", i, "sense"], "optimise.nothing");
    if (typeof lower === "number" && typeof upper === "number" && lower > upper) wrong(["goals", i, "upper"], "optimise.order");
  });
  if (readScenarios(form.scenarios) === undefined) wrong(["scenarios"], "optimise.badScenario");
});

/** The field of the form that a place of the request belongs to; null for places that have none. */
export function fieldOf(pointer: string): string | null {
  const [first = "", second = "", third = ""] = pointer.split("/").slice(1);
  if (first === "variables") return ["parameter", "lower", "upper"].includes(third) ? `variables.${second}.${third}` : `variables.${second}.parameter`;
  if (first === "goals") return ["lower", "upper", "sense", "output"].includes(third) ? `goals.${second}.${third}` : `goals.${second}.metric`;
  if (first === "scenarios") return "scenarios";
  if (first === "method") return second === "" || second === "kind" ? "method" : `options.${second}`;
  return null;
}
