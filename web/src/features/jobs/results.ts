import type { components } from "@/shared/api/schema";
import type { Metric } from "@/shared/api/types";
import type { GridMap } from "./optimization/map";

/** What an optimisation returns, as far as a page shows it. */
export interface GoalResult {
  metric: string;
  experiment: string | null;
  output: string | null;
  before: Metric;
  after: Metric;
  met: boolean;
  active: boolean;
  /** The scenario that counted, by its place in the request. */
  scenario?: number | null;
  /** By how many per cent the metric changes when a variable grows by one, at the optimum. */
  elasticities?: Record<string, number | null>;
}
export interface Curves {
  time: (number | null)[];
  outputs: Record<string, (number | null)[]>;
}
/** A goal at the optimum, computed again by the exact engine, and once more in another way where there is one. */
export interface Proof {
  goal: number;
  value: number | null;
  verdict?: string;
  violation: number | null;
  independent?: number | null;
  scenario: number;
  scenario_name?: string;
  at?: { time?: number | null; frequency?: number | null } | null;
}
export interface FrontPoint {
  parameters: Record<string, number>;
  goals: Metric[];
}

export interface OptimizationResult {
  status: string;
  advice: string;
  best: Record<string, number>;
  goals: GoalResult[];
  certificate: { valid: boolean; worst_violation: number | null; goals: Proof[] };
  curves: { before: Record<string, Curves>; after: Record<string, Curves> };
  history: { evaluation: number; objective: number | null; violation: number | null; variables?: Record<string, number> }[];
  evaluations: number;
  seconds: number;
  front?: FrontPoint[] | null;
  /** The number of the point of the front where giving up one objective begins to cost most of another. */
  knee?: number | null;
  map?: GridMap | null;
  system: { id: string; revision: number } | null;
  /** At a place without values for all goals: which of them stand against each other, by their shares. */
  conflict?: { goal: number; share: number | null }[];
  cross_check?: { method: string; status: string; objective: number | null; violation: number | null; gap: number | null }[];
  robustness?: { worst: { parameters: Record<string, number>; violation: number | null; objective: number | null } };
  yield?: { share: number; lower95: number; upper95: number; samples: number; unstable: number };
  /** Of several structures: the best one, and what each came to. */
  chosen?: string;
  alternatives?: { name: string; status: string; objective: number | null; certificate: { valid: boolean } }[];
}

/** Measures of agreement in per cent, by name. */
export type Fits = Record<string, number | null>;

export interface IdentificationResult {
  method?: string;
  status: string;
  advice: string;
  parameters: Record<string, { value: number; unit: string; lower95: number | null; upper95: number | null; start: number | null }>;
  fit?: { estimation: Record<string, Fits>; validation: Record<string, Fits>; baselines: Record<string, Record<string, Fits>> };
  one_step_prediction?: Record<string, Fits>;
  frequency_responses?: { name: string; outputs: Record<string, { fit_percent: number | null; relative_error_percent: number | null }> }[];
  indistinguishable?: string[];
  correlations?: (number | null)[][];
  residuals?: Record<string, { white: boolean; independent: boolean; autocorrelation: (number | null)[]; autocorrelation_bound: number | null }>;
  between_samples?: { chosen: string; tried: Record<string, { fit_percent: number | null }> } | null;
  warnings?: { pointer: string; detail: string }[];
  /** What the search was to take, and what it took. */
  expected?: { evaluations: number; seconds: number; bytes: number };
  evaluations?: number;
  seconds?: number;
  /** Of a model that was made without a document. */
  tried?: { order?: number; degree?: number; estimation?: number | null; validation: number | null }[];
  order?: number;
  degree?: number;
  document?: unknown;
  system?: { id: string; revision: number } | null;
}

export interface FitRow {
  part: string;
  output: string;
  numbers: Fits;
  /** Of a model that knows nothing, or of a prediction that knows the measurement. */
  trivial: boolean;
}

/** Fits of all outputs, each beside what needs no model to reach it. */
export function fitRows(fit: IdentificationResult["fit"], oneStep?: Record<string, Fits>): FitRow[] {
  const outputs = Object.keys(fit?.estimation ?? fit?.validation ?? {});
  return outputs.flatMap((output) => {
    const row = (part: string, numbers: Fits | undefined, trivial: boolean): FitRow[] => (numbers ? [{ part, output, numbers, trivial }] : []);
    return [
      ...row("estimation", fit?.estimation?.[output], false),
      ...row("validation", fit?.validation?.[output], false),
      ...Object.entries(fit?.baselines ?? {}).flatMap(([kind, fits]) => row(kind, fits[output], true)),
      ...row("one_step", oneStep?.[output], true),
    ];
  });
}

/** Fits of measured frequency responses in the complex plane, each output beside the name of its experiment. */
export function responseRows(responses: IdentificationResult["frequency_responses"]): FitRow[] {
  return (responses ?? []).flatMap(({ name, outputs }) =>
    Object.entries(outputs).map(([output, { fit_percent, relative_error_percent }]) => ({ part: "frequency", output: `${output} · ${name}`, numbers: { fit_percent, relative_error_percent }, trivial: false })),
  );
}

export function isOptimization(kind: string, body: unknown): body is OptimizationResult {
  return kind === "optimization" && typeof body === "object" && body !== null && "goals" in body && "best" in body;
}

export function isIdentification(kind: string, body: unknown): body is IdentificationResult {
  return kind === "identification" && typeof body === "object" && body !== null && "parameters" in body;
}

export function isValidation(kind: string, body: unknown): body is components["schemas"]["ValidationReply"] {
  return kind === "validation" && typeof body === "object" && body !== null && "verdict" in body && "outputs" in body;
}

/** The address of the front panel at these values. */
export function panelAt(system: string, values: Record<string, number>): string {
  const query = new URLSearchParams({ s: Object.keys(values).join(",") });
  for (const [path, value] of Object.entries(values)) query.set(`p.${path}`, String(Number(value.toPrecision(8))));
  query.set("ref", "1");
  return `/systems/${system}/panel?${query.toString()}`;
}

export function numbersOf(values: (number | null)[]): Float64Array {
  return Float64Array.from(values, (value) => value ?? NaN);
}
