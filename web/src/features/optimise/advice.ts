import type { MethodEntry, MetricEntry } from "@/shared/api/types";
import type { Search } from "./schema";

/** One sentence: a key of the translations, and what stands in its gaps. */
export interface Sentence {
  key: string;
  values?: Record<string, string | number>;
}

/** Numbers of a grid for the variables that are chosen freely. */
function pointsOf(form: Search, otherwise: number): number[] {
  const { points } = form.options;
  const each = Array.isArray(points) ? points : [];
  const all = typeof points === "number" ? points : otherwise;
  return form.variables.filter(({ chosen }) => chosen !== "tied").map((variable, i) => (variable.chosen === "list" ? (variable.choices?.length ?? 1) : each[i] ?? all));
}

/** What can be said of a method before it runs, beside what it is: the size of a grid, and goals that it does not do justice to. */
export function adviceOf(form: Search, method: MethodEntry | undefined, metrics: Map<string, Pick<MetricEntry, "domain">>): Sentence[] {
  const found: Sentence[] = [];
  const objectives = form.goals.filter(({ sense }) => sense !== "").length;
  const inTime = (metric: string) => metrics.get(metric)?.domain === "time";
  if (objectives === 0 && !form.goals.some(({ soft }) => soft)) found.push({ key: "optimise.advice.noObjective" });
  if (form.method === "pareto" && objectives < 2) found.push({ key: "optimise.advice.oneObjective" });
  if (objectives > 1 && !["pareto", "auto"].includes(form.method)) found.push({ key: "optimise.advice.weighted", values: { objectives } });
  if (form.method === "grid" && (form.options.sampling ?? "full") === "full") {
    const points = pointsOf(form, Number(method?.parameters.find(({ name }) => name === "points")?.default ?? 21));
    found.push({ key: "optimise.advice.grid", values: { product: points.join(" × "), total: points.reduce((size, n) => size * n, 1) } });
  }
  if (form.method === "convex" && form.goals.some(({ metric }) => inTime(metric) && metric !== "ie")) found.push({ key: "optimise.advice.convex" });
  return found;
}
