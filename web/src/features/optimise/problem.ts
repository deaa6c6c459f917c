import { readScenarios } from "@/shared/systems/scenarios";
import { readCurve } from "./curves";
import { needsOf, numberOf, type Goal, type Search, type Structure, type Variable } from "./schema";
import { readParts, readRanges, WIRE } from "./structures";

export interface Domains {
  /** What a metric needs: "time", "path", "loop" or "system". */
  get(metric: string): string | undefined;
}

/** The metrics that a row can ask for; what it already asks for stays among them. */
export function goalMetrics<M extends { kind: string; domain: string }>(metrics: Iterable<M>, loops: string[], asked: string): M[] {
  return [...metrics].filter(({ kind, domain }) => kind === asked || domain !== "loop" || loops.length > 0);
}

/** What has been said; the service knows what to take for the rest. */
function said<Fields extends object>(fields: Fields): Partial<Fields> {
  return Object.fromEntries(Object.entries(fields).filter(([, value]) => value !== undefined && value !== "")) as Partial<Fields>;
}

function variableOf({ parameter, chosen, lower, upper, scale, start, choices, expression }: Variable): object {
  if (chosen === "tied") return said({ parameter, expression });
  if (chosen === "list") return said({ parameter, choices, start });
  return said({ parameter, lower, upper, scale, start, integer: chosen === "whole" ? true : undefined });
}

function placeOf(goal: Goal, domain: string | undefined, experiment: string): object {
  if (domain === "loop") return { open_at: goal.loop };
  if (domain === "path") return { from: goal.from, to: goal.output };
  return domain === "system" ? {} : { experiment, output: goal.output };
}

/** What a metric is held against besides bounds; what cannot be read has been told before. */
function heldAgainst(goal: Goal): object {
  const needs = needsOf(goal.metric);
  const number = numberOf(goal.metric);
  if (number !== undefined) return said({ [number.field]: goal.number });
  if (needs === "band") return { band: goal.band };
  if (needs === "reference") return { reference: readCurve(goal.reference ?? "", "time") };
  if (needs === "") return {};
  const curve = (text: string | undefined) => (text?.trim() ? readCurve(text, needs === "envelope" ? "time" : "frequency") : undefined);
  return { bounds: said({ upper: curve(goal.upperCurve), lower: curve(goal.lowerCurve), scale: needs === "envelope" ? goal.curveScale : undefined }) };
}

/** Goals of the request with the rows that ask for them: a row that names no experiment asks for each. */
function goalsOf(form: Search, domains: Domains): { row: number; goal: object }[] {
  return form.goals.flatMap((goal, row) => {
    const domain = domains.get(goal.metric);
    const within = (domain ?? "time") === "time" && goal.experiment === "" ? form.experiments.map(({ name }) => name) : [goal.experiment];
    const { metric, sense, lower, upper, target, tolerance, soft, weight, settled } = goal;
    const accept = settled && (domain ?? "time") === "time" ? "ok" : undefined;
    return within.map((experiment) => ({ row, goal: { metric, ...placeOf(goal, domain, experiment), ...heldAgainst(goal), ...said({ sense, lower, upper, target, tolerance, weight, hard: soft ? false : undefined, accept }) } }));
  });
}

/** The row of each goal of the request. */
export function rowsOf(form: Search, domains: Domains): number[] {
  return goalsOf(form, domains).map(({ row }) => row);
}

/** A stored system, or this one with parts removed and added: what was chosen of a removed block falls away. */
function alternativeOf({ id, name, removed = [], added, ranges }: Structure, form: Search): object {
  if (id !== "") return { name: name || id, system: id };
  const blocks = removed.filter((part) => !part.includes(WIRE));
  const wires = removed.filter((part) => part.includes(WIRE)).map((part) => part.split(WIRE));
  const kept = form.variables.filter(({ parameter }) => !blocks.includes(parameter.split(".")[0]!));
  const own = readRanges(ranges ?? "") ?? [];
  const remove = { ...(blocks.length > 0 ? { blocks } : {}), ...(wires.length > 0 ? { connections: wires.map(([from, to]) => ({ from, to })) } : {}) };
  const add = added?.trim() ? readParts(added) : undefined;
  return {
    name,
    ...(removed.length > 0 ? { remove } : {}),
    ...(add ? { add } : {}),
    ...(kept.length < form.variables.length || own.length > 0 ? { variables: [...kept.filter(({ parameter }) => !own.some((other) => other.parameter === parameter)).map(variableOf), ...own] } : {}),
  };
}

/** An option that holds several numbers has one for each variable that is chosen freely. */
function optionOf(value: number | string | number[], form: Search): unknown {
  if (!Array.isArray(value)) return value;
  const free = form.variables.filter(({ chosen }) => chosen !== "tied");
  return Object.fromEntries(free.flatMap(({ parameter }, i) => (value[i] === undefined ? [] : [[parameter, value[i]]])));
}

/** The body of an optimisation, in the words of the contract. */
export function bodyOf(form: Search, system: string, domains: Domains): Record<string, unknown> {
  const scenarios = readScenarios(form.scenarios);
  const queue = said({ priority: form.priority === "normal" ? undefined : form.priority, time_limit: form.limit, deadline: form.deadline });
  return {
    system,
    variables: form.variables.map(variableOf),
    experiments: form.experiments.map(({ name, commands, duration }) => ({ name, input: commands.length === 1 ? commands[0] : commands, ...said({ duration }) })),
    goals: goalsOf(form, domains).map(({ goal }) => goal),
    ...(scenarios && scenarios.length > 0 ? { scenarios: [{}, ...scenarios] } : {}),
    ...(form.across === "mean" ? { across_scenarios: "mean" } : {}),
    ...(form.uncertain.length > 0 ? { uncertain: form.uncertain.map(said) } : {}),
    ...(form.draws ? { yield_samples: form.draws } : {}),
    ...(form.structures.length > 0 ? { alternatives: [{ name: "this system" }, ...form.structures.map((structure) => alternativeOf(structure, form))] } : {}),
    method: { kind: form.method, ...Object.fromEntries(Object.entries(form.options).map(([name, value]) => [name, optionOf(value, form)])) },
    ...(form.others.length > 0 ? { cross_check: form.others } : {}),
    ...(Object.keys(queue).length > 0 ? { queue } : {}),
  };
}
