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
}
export interface Curves {
  time: (number | null)[];
  outputs: Record<string, (number | null)[]>;
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
  certificate: { valid: boolean; worst_violation: number | null; goals: { goal: number; value: number | null; violation: number | null; scenario: number; independent?: number | null }[] };
  curves: { before: Record<string, Curves>; after: Record<string, Curves> };
  history: { evaluation: number; objective: number | null; violation: number | null; variables?: Record<string, number> }[];
  evaluations: number;
  seconds: number;
  front?: FrontPoint[] | null;
  /** The number of the point of the front where giving up one objective begins to cost most of another. */
  knee?: number | null;
  map?: GridMap | null;
  system: { id: string; revision: number } | null;
}

export interface IdentificationResult {
  status: string;
  advice: string;
  parameters: Record<string, { value: number; unit: string; lower95: number | null; upper95: number | null; start: number }>;
  fit: Record<string, Record<string, Record<string, number | null>>>;
  indistinguishable: string[];
}

export function isOptimization(kind: string, body: unknown): body is OptimizationResult {
  return kind === "optimization" && typeof body === "object" && body !== null && "goals" in body && "best" in body;
}

export function isIdentification(kind: string, body: unknown): body is IdentificationResult {
  return kind === "identification" && typeof body === "object" && body !== null && "parameters" in body;
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
