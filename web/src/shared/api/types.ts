import type { components } from "./schema";

type Schemas = components["schemas"];
export type StoredSystem = Schemas["StoredSystem"];
export type ElementEntry = Schemas["ElementEntry"] & { output_units?: Record<string, string>; example?: Record<string, unknown> };
export type ParameterEntry = Schemas["ParameterEntry"] & { choices?: string[]; lower_open?: boolean };
export type MetricEntry = Schemas["MetricEntry"];
export type MethodEntry = Schemas["MethodEntry"];
export type JobReply = Schemas["JobReply"];
export type InfluenceReply = Schemas["InfluenceReply"];

/** A number, a quantity with its unit, or an expression that begins with "=". */
export type Scalar = number | string | { value: number; unit: string };
export interface ParameterDocument {
  value: Scalar;
  unit?: string;
  lower?: Scalar;
  upper?: Scalar;
  scale?: "linear" | "log";
  doc?: string;
}
export type Block = { kind: string; system?: SystemDocument } & Record<string, unknown>;
export interface Connection {
  from: string;
  to: string;
}
/** A system document as people edit it; the service checks it, so the union over all kinds of blocks is not repeated here. */
export interface SystemDocument {
  name?: string;
  doc?: string;
  parameters?: Record<string, ParameterDocument>;
  blocks: Record<string, Block>;
  connections?: Connection[];
  outputs: Record<string, string>;
}
export type WireSystem = Schemas["SystemDocument"];

export interface Metric {
  value: number | null;
  unit: string;
  verdict: string;
  advice?: string | null;
  /** How far the value may still change where the response had not settled. */
  doubt?: number | null;
}
