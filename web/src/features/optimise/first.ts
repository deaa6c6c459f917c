import { useQuery } from "@tanstack/react-query";
import { api, atOnce } from "@/shared/api/client";
import type { SystemDocument } from "@/shared/api/types";
import type { LiveParameter, Opened } from "@/shared/live/protocol";
import type { Last } from "@/shared/systems/last";
import { firstSliders } from "@/shared/systems/movable";
import type { GoalRow } from "@/shared/systems/search";
import { wholeOf } from "./address";
import { effortOf, gainsOf, type Effort } from "@/shared/systems/controllers";
import type { Search } from "./schema";

/** Without a limit that the system states, an optimum may ask for so many times the effort of now. */
const ROOM = 2;

const rounded = (value: number): number => Number(value.toPrecision(3));

/** A bound, or a decade to both sides of the value where there is none that is near. */
function rangeOf({ lower, upper, value }: LiveParameter) {
  const wide = (bound: number | null) => bound === null || bound === 0 || Math.abs(bound) > 100 * Math.abs(value);
  return { lower: wide(lower) ? rounded(value > 0 ? value / 10 : value * 10) : lower!, upper: wide(upper) ? rounded(value > 0 ? value * 10 : value / 10) : upper! };
}

/** What a first visit begins with: what the panel showed, or what makes sense for most loops; the controller's gains; a bound on the effort. */
export function firstOf(opened: Opened, document: SystemDocument, loops: string[], last: Last["search"] | undefined, effort: Bounded | null): Search {
  const output = outputOf(opened, last);
  const known = new Map(opened.parameters.map((p) => [p.path, p]));
  const gains = gainsOf(document, opened.parameters);
  const usual: GoalRow[] = [
    { metric: "response_time", output, sense: "minimize" },
    { metric: "overshoot", output, sense: "", upper: 0.05 },
    ...(loops.length > 0 ? [{ metric: "sensitivity_peak", output, sense: "" as const, upper: 2 }] : []),
  ];
  // Bounds alone leave nothing to choose by: the answer is to be quick, too.
  const wanted = (last?.goals.length ?? 0) > 0 ? [...(last!.goals.some(({ sense }) => sense !== "") ? [] : usual.slice(0, 1).filter(({ metric }) => !last!.goals.some((goal) => goal.metric === metric))), ...last!.goals] : usual;
  const bounded = effort && !wanted.some(({ metric }) => metric === effort.metric) ? [{ metric: effort.metric, output: effort.output, sense: "" as const, upper: effort.upper }] : [];
  return wholeOf({
    input: inputOf(opened, last),
    amplitude: last?.amplitude ?? 1,
    loop: last && loops.includes(last.loop) ? last.loop : (loops[0] ?? ""),
    variables: (gains.length > 0 ? gains : firstSliders(opened.parameters, 3)).map((parameter) => ({ parameter, ...rangeOf(known.get(parameter)!), ...startOf(last, parameter) })),
    goals: [...wanted, ...bounded],
    scenarios: "",
    method: "auto",
    options: {},
  });
}

const startOf = (last: Last["search"] | undefined, parameter: string) => (last?.values[parameter] === undefined ? {} : { start: last.values[parameter] });
const outputOf = (opened: Opened, last?: Last["search"]): string => opened.outputs.find(({ name }) => name === last?.output)?.name ?? opened.outputs[0]?.name ?? "";
const inputOf = (opened: Opened, last?: Last["search"]): string => opened.inputs.find((name) => name === last?.input) ?? opened.inputs[0] ?? "";

/** An effort with the bound that is proposed for it. */
export type Bounded = Effort & { upper: number };

/**
 * The bound on the effort that a form begins with: what the system states, else twice what it is now, which a simulation tells.
 * `pending` while that is computed; null where there is nothing to be bounded, or no number.
 */
export function useEffort(id: string, revision: number, opened: Opened | undefined, document: SystemDocument, last: Last["search"] | undefined, wanted: boolean): { pending: boolean; effort: Bounded | null } {
  const effort = opened && wanted ? effortOf(document, opened, outputOf(opened, last)) : null;
  const open = effort !== null && effort.limit === null;
  const input = opened ? inputOf(opened, last) : "";
  const now = useQuery({
    queryKey: ["effort", id, revision, input, last?.amplitude, effort?.output],
    enabled: open,
    retry: false,
    staleTime: Infinity,
    queryFn: async () => {
      const { variants } = await atOnce(api.POST("/v1/simulations", { body: { system: id, input: { port: input, signal: { kind: "step", amplitude: last?.amplitude ?? 1, start: 0 } }, outputs: [effort!.output], metrics: [effort!.metric], samples: 2, duration: "auto", keep: false } }));
      return variants[0]?.metrics[effort!.output]?.[effort!.metric]?.value ?? null;
    },
  });
  if (!effort) return { pending: false, effort: null };
  if (effort.limit) return { pending: false, effort: { ...effort, upper: rounded(effort.limit.value) } };
  const value = now.data;
  return { pending: now.isPending, effort: typeof value === "number" && value > 0 ? { ...effort, upper: rounded(ROOM * value) } : null };
}
