import type { Scalar } from "@/shared/api/types";

export interface VariableRow {
  parameter: string;
  lower?: Scalar;
  upper?: Scalar;
}
export interface GoalRow {
  metric: string;
  /** Of a time metric: the output; of a metric of a path: its end. */
  output: string;
  sense: "" | "minimize" | "maximize";
  lower?: Scalar;
  upper?: Scalar;
}

/** A search as its form knows it; the address of the page holds one as JSON. */
export interface ProblemForm {
  input: string;
  amplitude: number;
  loop: string;
  variables: VariableRow[];
  goals: GoalRow[];
  /** Lines like `motor.mass = 2000; load = 5`: one scenario each, beside the nominal one. */
  scenarios: string;
  method: string;
  options: Record<string, number | string>;
}

/** The address of the form with these entries. */
export function searchAt(system: string, form: ProblemForm): string {
  return `/systems/${system}/optimise?f=${encodeURIComponent(JSON.stringify(form))}`;
}
