import { WANTED, type PanelGoal } from "@/shared/responses/goals";
import type { Goal } from "./schema";

/** Bounds that a picture has a place for: of the looked-at output and loop, in SI. */
export function drawnGoals(goals: readonly Goal[], output: string): (PanelGoal & { row: number })[] {
  const found = goals.flatMap((goal, row) => {
    const wanted = WANTED[goal.metric];
    const value = wanted && goal[wanted.bound];
    if (!wanted || typeof value !== "number") return [];
    const elsewhere = wanted.domain === "time" && goal.output !== output;
    return elsewhere && goal.metric !== "control_effort" ? [] : [{ metric: goal.metric, bound: wanted.bound, value, row, ...(elsewhere ? { output: goal.output } : {}) }];
  });
  // Of several bounds of one metric the first is drawn: its grip moves one row.
  return found.filter((goal, i) => found.findIndex(({ metric }) => metric === goal.metric) === i);
}
