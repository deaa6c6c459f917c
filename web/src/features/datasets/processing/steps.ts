import { bodyOf, fieldsOf, missing, type Field, type Schemas, type Values } from "@/shared/forms/schema";

/** What is done to a recording, step by step, as the page's address holds it. */
export interface Step extends Values {
  kind: string;
}
export interface Plan {
  name: string;
  /** Further recordings beside the one of the page. */
  others: string[];
  combine: "append" | "side_by_side";
  steps: Step[];
}

/** The kinds of steps that the service knows, with their fields. */
export function stepKinds(schemas: Schemas): Map<string, Field[]> {
  const listed = schemas.ProcessingRequest?.properties?.steps?.items?.oneOf ?? [];
  return new Map(
    listed.flatMap(({ $ref }) => {
      const schema = schemas[$ref?.split("/").at(-1) ?? ""];
      const kind = schema?.properties?.kind?.const;
      return schema && typeof kind === "string" ? [[kind, fieldsOf(schema, ["kind"])] as const] : [];
    }),
  );
}

export function readPlan(query: URLSearchParams): Plan {
  let steps: Step[] = [];
  try {
    const found: unknown = JSON.parse(query.get("steps") ?? "[]");
    if (Array.isArray(found)) steps = found.filter((step): step is Step => typeof step === "object" && step !== null && typeof (step as Step).kind === "string");
  } catch {
    // An address that was cut short holds no steps.
  }
  return { name: query.get("name") ?? "", others: (query.get("and") ?? "").split(",").filter(Boolean), combine: query.get("combine") === "side_by_side" ? "side_by_side" : "append", steps };
}

export function writePlan({ name, others, combine, steps }: Plan): URLSearchParams {
  const query = new URLSearchParams();
  if (name) query.set("name", name);
  if (others.length > 0) query.set("and", others.join(","));
  if (combine !== "append") query.set("combine", combine);
  if (steps.length > 0) query.set("steps", JSON.stringify(steps));
  return query;
}

/** The channels that a step finds, after those before it. */
export function channelsBefore(channels: string[], steps: Step[], index: number): string[] {
  return steps.slice(0, index).reduce((known, step) => {
    if (step.kind === "select" && Array.isArray(step.channels) && step.channels.length > 0) return step.channels.map(String);
    if ((step.kind === "differentiate" || step.kind === "integrate") && typeof step.name === "string" && !known.includes(step.name)) return [...known, step.name];
    return known;
  }, channels);
}

/** The fields that are still empty, as `<step>.<field>`. */
export function gaps(plan: Plan, kinds: Map<string, Field[]>): string[] {
  return plan.steps.flatMap((step, i) => missing(kinds.get(step.kind) ?? [], step).map((name) => `${i}.${name}`));
}

export function requestOf(plan: Plan, dataset: string, kinds: Map<string, Field[]>): Record<string, unknown> {
  return { name: plan.name, sources: [dataset, ...plan.others], ...(plan.others.length > 0 ? { combine: plan.combine } : {}), steps: plan.steps.map((step) => ({ kind: step.kind, ...bodyOf(kinds.get(step.kind) ?? [], step) })) };
}
