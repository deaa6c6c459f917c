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
