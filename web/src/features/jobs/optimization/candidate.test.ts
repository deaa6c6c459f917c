import { expect, it } from "vitest";
import type { GoalResult } from "../results";
import { candidateOf, studiesOf, type Asked } from "./candidate";

const domains = new Map([["overshoot", { domain: "time" as const }], ["phase_margin", { domain: "loop" as const }], ["damping_ratio", { domain: "system" as const }], ["envelope", { domain: "time" as const }]]);
const asked: Asked = {
  system: { blocks: {} },
  experiments: [{ name: "step", input: { port: "u" } }],
  goals: [{ metric: "overshoot", experiment: "step", output: "y" }, { metric: "phase_margin", open_at: "error" }, { metric: "damping_ratio" }, { metric: "envelope", experiment: "step", output: "y", bounds: {} }],
  scenarios: [{}, { m: 2 }, { m: 3 }],
};
const goals = [0, 2, 0, 0].map((scenario, i) => ({ metric: asked.goals[i]!.metric, scenario })) as unknown as GoalResult[];
const value = (number: number) => ({ value: number, unit: "1", verdict: "ok" });

it("a candidate is asked for once for each experiment and each loop, in the scenarios that counted", () => {
  const [step, loop, ...more] = studiesOf(asked, goals, domains, { kp: 4 });
  expect(more).toEqual([]);
  expect(step).toEqual({ key: "simulation:step", kind: "simulation", body: { system: asked.system, variants: [{ kp: 4 }, { m: 3, kp: 4 }], metrics: ["overshoot"], input: { port: "u" }, samples: 400 } });
  expect(loop!.body).toEqual({ system: asked.system, variants: [{ kp: 4 }, { m: 3, kp: 4 }], metrics: ["phase_margin", "damping_ratio"], frequencies: [1, 2], open_at: "error" });
});

it("what comes back belongs to the goals, each in its scenario; a mask is not read by itself", () => {
  const curves = { time: [0, 1], outputs: { y: [0, 1] } };
  const replies = new Map([
    ["simulation:step", [{ ...curves, metrics: { y: { overshoot: value(0.1) } } }, { ...curves, metrics: { y: { overshoot: value(0.3) } } }]],
    ["frequency:error||", [{ metrics: { phase_margin: value(1), damping_ratio: value(0.5) } }, { metrics: { phase_margin: value(0.7), damping_ratio: value(0.2) } }]],
  ]);
  const found = candidateOf(asked, goals, domains, replies);
  expect(found.goals.map((goal) => goal?.value ?? null)).toEqual([0.1, 0.7, 0.5, null]);
  expect(found.curves).toEqual({ step: curves });
});

it("places that are opened together are asked for as a list; a metric with a number of its own is left to the search", () => {
  const several: Asked = { ...asked, goals: [{ metric: "phase_margin", open_at: ["inner", "outer"] }, { metric: "overshoot", experiment: "step", output: "y", settling_band: 0.1 }] };
  const [step, loop] = studiesOf(several, goals.slice(0, 2), domains, { kp: 4 });
  expect(step!.body.metrics).toEqual([]);
  expect(loop!.body.open_at).toEqual(["inner", "outer"]);
});
