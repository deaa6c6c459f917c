import { fieldsOf, type Field, type Schemas, type Values } from "@/shared/forms/schema";

/** Ways to identify; all but the first need no system, only channels of a recording. */
export const METHODS = ["grey_box", "subspace", "transfer_function", "inverse_dynamics", "static_curve"] as const;
export type Method = (typeof METHODS)[number];
export type Direct = Exclude<Method, "grey_box">;

const REQUESTS: Record<Direct, string> = { subspace: "BlackBoxRequest", transfer_function: "BlackBoxRequest", inverse_dynamics: "InverseDynamicsRequest", static_curve: "StaticCurveRequest" };
/** Only a transfer function has a delay of its own. */
const NOT_OF: Partial<Record<Direct, string[]>> = { subspace: ["largest_delay"] };

export function methodIn(query: URLSearchParams): Method {
  return METHODS.find((method) => method === query.get("method")) ?? "grey_box";
}

/** What a method asks beside its recording. */
export function directFields(schemas: Schemas, method: Direct): Field[] {
  return fieldsOf(schemas[REQUESTS[method]] ?? {}, ["method", "dataset", ...(NOT_OF[method] ?? [])]);
}

/** What was filled in, as the address holds it. */
export function readValues(query: URLSearchParams): Values {
  try {
    const found: unknown = JSON.parse(query.get("f") ?? "{}");
    return typeof found === "object" && found !== null && !Array.isArray(found) ? (found as Values) : {};
  } catch {
    return {};
  }
}
