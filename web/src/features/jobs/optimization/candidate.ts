import type { MetricEntry, Metric, Scalar } from "@/shared/api/types";
import type { Curves, GoalResult } from "../results";

type Values = Record<string, Scalar>;

/** What a search was asked for, as far as one of its candidates is looked at again. */
export interface Asked {
  system: unknown;
  experiments?: { name: string; input: unknown; duration?: unknown }[];
  variables?: { parameter: string; lower?: Scalar | null; upper?: Scalar | null }[];
  goals: AskedGoal[];
  scenarios?: (Values | { name: string; parameters: Values })[];
  alternatives?: { name: string; system?: unknown }[] | null;
}
export interface AskedGoal {
  metric: string;
  experiment?: string | null;
  output?: string | null;
  from?: string | null;
  to?: string | null;
  open_at?: string | string[] | null;
  band?: unknown;
  lower?: Scalar | null;
  upper?: Scalar | null;
  [other: string]: unknown;
}

type Domains = Map<string, Pick<MetricEntry, "domain">>;

/** One question to the service: a simulation of an experiment, or a path or opened loop over frequency. */
export interface Study {
  key: string;
  kind: "simulation" | "frequency";
  body: Record<string, unknown>;
}
export interface StudyVariant {
  time?: (number | null)[];
  outputs?: Record<string, (number | null)[]>;
  metrics: Record<string, unknown>;
}

/** Samples of each curve: as many as a plot has pixels for. */
const SAMPLES = 400;
/** What a goal gives its metric besides a place: a study has one of each for all, so that only the search tells the metric. */
const ITS_OWN = ["bounds", "reference", "settling_band", "recovery_band", "noise_density", "derivative"];

const pathKey = ({ from, to, open_at }: AskedGoal) => `${open_at ?? ""}|${from ?? ""}|${to ?? ""}`;

/** The question that tells a goal's metric; null for one that is held against something of its own, which only a search does. */
function studyOf(goal: AskedGoal, asked: Asked, domains: Domains): string | null {
  if (ITS_OWN.some((key) => goal[key] != null)) return null;
  const domain = domains.get(goal.metric)?.domain;
  if (domain === "time") return `simulation:${goal.experiment ?? asked.experiments?.[0]?.name ?? ""}`;
  if (domain === "system") {
    const other = asked.goals.find((one) => one.open_at || one.from);
    return other ? `frequency:${pathKey(other)}` : null;
  }
  return domain === undefined ? null : `frequency:${pathKey(goal)}`;
}

/** The scenarios that counted for some goal, the nominal one first. */
export function scenariosOf(asked: Asked, goals: GoalResult[]): number[] {
  const count = asked.scenarios?.length || 1;
  return [...new Set([0, ...goals.map((goal) => (goal.scenario ?? 0) < count ? (goal.scenario ?? 0) : 0)])];
}

/** The values of a scenario, whether it has a name or not. */
function valuesOf(scenario: NonNullable<Asked["scenarios"]>[number] | undefined): Values {
  return scenario !== undefined && typeof scenario.name === "string" && "parameters" in scenario ? (scenario.parameters as Values) : ((scenario ?? {}) as Values);
}

/** Everything that must be computed to see curves and metrics at a candidate's values. */
export function studiesOf(asked: Asked, goals: GoalResult[], domains: Domains, values: Record<string, number>): Study[] {
  const variants = scenariosOf(asked, goals).map((i) => ({ ...valuesOf(asked.scenarios?.[i]), ...values }));
  const wanted = new Map<string, AskedGoal[]>();
  for (const experiment of asked.experiments ?? []) wanted.set(`simulation:${experiment.name}`, []);
  for (const goal of asked.goals) {
    const key = studyOf(goal, asked, domains);
    if (key !== null) wanted.set(key, [...(wanted.get(key) ?? []), goal]);
  }
  return [...wanted].map(([key, asking]): Study => {
    const metrics = [...new Set(asking.map((goal) => goal.metric))];
    const common = { system: asked.system, variants, metrics };
    if (key.startsWith("simulation:")) {
      const { input, duration } = asked.experiments!.find(({ name }) => `simulation:${name}` === key)!;
      const band = asking.find((goal) => goal.band != null)?.band;
      return { key, kind: "simulation", body: { ...common, input, samples: SAMPLES, ...(duration != null ? { duration } : {}), ...(band !== undefined ? { band } : {}) } };
    }
    const [open_at, from, to] = key.slice("frequency:".length).split("|");
    // Metrics are exact and need no curve: two lines are the shortest one.
    return { key, kind: "frequency", body: { ...common, frequencies: [1, 2], ...(open_at ? { open_at: open_at.includes(",") ? open_at.split(",") : open_at } : { from, to }) } };
  });
}

export interface Candidate {
  curves: Record<string, Curves>;
  /** One for each goal, null where the metric is not told by itself. */
  goals: (Metric | null)[];
}

/** What came back, in the order of the goals. */
export function candidateOf(asked: Asked, goals: GoalResult[], domains: Domains, replies: Map<string, StudyVariant[]>): Candidate {
  const scenarios = scenariosOf(asked, goals);
  const curves = Object.fromEntries(
    [...replies].flatMap(([key, variants]) => {
      const { time, outputs } = variants[0] ?? { metrics: {} };
      return key.startsWith("simulation:") && time && outputs ? [[key.slice("simulation:".length), { time, outputs }]] : [];
    }),
  );
  return {
    curves,
    goals: asked.goals.map((goal, i) => {
      const key = studyOf(goal, asked, domains);
      const variant = key === null ? undefined : replies.get(key)?.[Math.max(0, scenarios.indexOf(goals[i]?.scenario ?? 0))];
      if (!variant) return null;
      const metrics = (domains.get(goal.metric)?.domain === "time" ? variant.metrics[goal.output ?? ""] : variant.metrics) as Record<string, Metric> | undefined;
      return metrics?.[goal.metric] ?? null;
    }),
  };
}
