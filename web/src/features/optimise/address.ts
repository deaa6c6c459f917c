import type { Opened } from "@/shared/live/protocol";
import { firstSliders } from "@/shared/systems/movable";
import type { GoalRow, ProblemForm } from "@/shared/systems/search";
import { shape, type Goal, type Search, type Variable } from "./schema";

/** Characters of a form that an address takes; longer ones, with recorded commands say, stay in the tab. */
const LONGEST = 6000;
const DRAFT = "draft";
const place = (system: string) => `servotune.search.${system}`;

/** What the address holds of a form; a form that is too long is kept beside it. */
export function addressOf(system: string, form: Search): string {
  const text = JSON.stringify(form);
  if (text.length <= LONGEST) return text;
  try {
    sessionStorage.setItem(place(system), text);
  } catch {
    return text; // no room, or no storage: a long address is better than nothing
  }
  return DRAFT;
}

/** The form that the address holds, if it does: a whole one, or the short one with which other pages begin a search. */
export function formAt(system: string, text: string | null): Search | null {
  if (!text) return null;
  try {
    const given: unknown = JSON.parse(text === DRAFT ? (sessionStorage.getItem(place(system)) ?? "null") : text);
    const whole = shape.safeParse(given);
    if (whole.success) return whole.data;
    const short = shape.safeParse(wholeOf(given as ProblemForm));
    return short.success ? short.data : null;
  } catch {
    return null;
  }
}

/** A goal that nothing more has been said of. */
export function goalOf({ metric, output, sense, lower, upper }: GoalRow, from: string, loop: string): Goal {
  return { metric, output, experiment: "", from, loop, sense, lower, upper, soft: false };
}

/** A form out of the few things that another page knows. */
export function wholeOf({ input, amplitude, loop, variables, goals, scenarios, method, options }: ProblemForm): Search {
  return {
    experiments: [{ name: "step", commands: [{ port: input, signal: { kind: "step", amplitude } }] }],
    variables: variables.map((row): Variable => ({ ...row, chosen: "range" })),
    goals: goals.map((row) => goalOf(row, input, loop)),
    scenarios,
    across: "worst",
    uncertain: [],
    structures: [],
    method,
    options,
    others: [],
    priority: "normal",
  };
}

/** A first visit is given a form that makes sense for most loops. */
export function firstOf(opened: Opened, loops: string[]): Search {
  const output = opened.outputs[0]?.name ?? "";
  const known = new Map(opened.parameters.map((p) => [p.path, p]));
  return wholeOf({
    input: opened.inputs[0] ?? "",
    amplitude: 1,
    loop: loops[0] ?? "",
    variables: firstSliders(opened.parameters, 3).map((parameter) => {
      const { lower, upper, value } = known.get(parameter)!;
      const wide = (bound: number | null) => bound === null || bound === 0 || Math.abs(bound) > 100 * Math.abs(value);
      return { parameter, lower: wide(lower) ? Number((value > 0 ? value / 10 : value * 10).toPrecision(3)) : lower!, upper: wide(upper) ? Number((value > 0 ? value * 10 : value / 10).toPrecision(3)) : upper! };
    }),
    goals: [
      { metric: "response_time", output, sense: "minimize" },
      { metric: "overshoot", output, sense: "", upper: 0.05 },
      ...(loops.length > 0 ? [{ metric: "sensitivity_peak", output, sense: "" as const, upper: 2 }] : []),
    ],
    scenarios: "",
    method: "auto",
    options: {},
  });
}
