import { describe, expect, it } from "vitest";
import { readScenarios } from "@/shared/systems/scenarios";
import { bodyOf, curlOf, goalMetrics, pythonOf } from "./problem";
import { fieldOf, search, shape } from "./schema";
import type { ProblemForm } from "@/shared/systems/search";

const domains = new Map([["overshoot", "time"], ["bandwidth", "path"], ["phase_margin", "loop"], ["damping_ratio", "system"]]);
const form: ProblemForm = {
  input: "r",
  amplitude: 0.1,
  loop: "e",
  variables: [{ parameter: "kp", lower: 1 }],
  goals: [
    { metric: "overshoot", output: "y", sense: "", upper: 0.05 },
    { metric: "bandwidth", output: "y", sense: "maximize" },
    { metric: "phase_margin", output: "y", sense: "", lower: { value: 45, unit: "deg" } },
    { metric: "damping_ratio", output: "y", sense: "", lower: 0.3 },
  ],
  scenarios: "m = 2k; load = 5 daN\n",
  method: "gradient",
  options: { starts: 4 },
};

it("a form becomes the body of the contract", () =>
  expect(bodyOf(form, "sys_1", domains)).toEqual({
    system: "sys_1",
    variables: [{ parameter: "kp", lower: 1 }],
    experiments: [{ name: "step", input: { port: "r", signal: { kind: "step", amplitude: 0.1 } } }],
    goals: [
      { metric: "overshoot", experiment: "step", output: "y", upper: 0.05 },
      { metric: "bandwidth", from: "r", to: "y", sense: "maximize" },
      { metric: "phase_margin", open_at: "e", lower: { value: 45, unit: "deg" } },
      { metric: "damping_ratio", lower: 0.3 },
    ],
    scenarios: [{}, { m: 2000, load: { value: 5, unit: "daN" } }],
    method: { kind: "gradient", starts: 4 },
  }));

it("a row offers the metrics that it can say, and the one that it has", () => {
  const metrics = [["overshoot", "time"], ["envelope", "time"], ["band_energy", "time"], ["tracking_error", "time"], ["loop_bound", "loop"], ["phase_margin", "loop"]].map(([kind, domain]) => ({ kind: kind!, domain: domain! }));
  const offered = (loops: string[], asked: string) => goalMetrics(metrics, loops, asked).map((m) => m.kind);
  expect(offered(["e"], "overshoot")).toEqual(["overshoot", "phase_margin"]);
  expect(offered([], "overshoot")).toEqual(["overshoot"]);
  expect(offered(["e"], "envelope")).toEqual(["overshoot", "envelope", "phase_margin"]);
});

it("an option of a method may be one of its choices", () => expect(bodyOf({ ...form, method: "grid", options: { sampling: "sobol", samples: 64 } }, "sys_1", domains).method).toEqual({ kind: "grid", sampling: "sobol", samples: 64 }));

describe("scenarios", () => {
  it("that cannot be read are none", () => expect(readScenarios("m : 5")).toBeUndefined());
  it("may be left out", () => expect(readScenarios("\n")).toEqual([]));
});

it("is copied as Python and for a shell", () => {
  const body = bodyOf({ ...form, scenarios: "" }, "sys_1", domains);
  expect(pythonOf(body, "http://host")).toContain('job = client.optimize(\n    "sys_1",\n    variables=[\n        {\n            "parameter": "kp",');
  expect(curlOf({ name: "it's" }, "http://host")).toContain(`'{"name":"it'\\''s"}'`);
});

describe("the form", () => {
  const faults = (changed: Partial<ProblemForm>) => (search.safeParse({ ...form, scenarios: "", ...changed }).error?.issues ?? []).map((issue) => `${issue.path.join(".")}: ${issue.message}`);
  it("that makes sense has no faults", () => expect(faults({})).toEqual([]));
  it("tells what is wrong where it is", () => {
    expect(faults({ variables: [{ parameter: "kp", lower: 2, upper: 1 }, { parameter: "kp" }] })).toEqual(["variables.0.upper: optimise.order", "variables.1.parameter: optimise.twice"]);
    expect(faults({ goals: [{ metric: "overshoot", output: "y", sense: "" }] })).toEqual(["goals.0.sense: optimise.nothing"]);
    expect(faults({ scenarios: "nothing" })).toEqual(["scenarios: optimise.badScenario"]);
  });
  it("of an address is read, or not at all", () => {
    expect(shape.safeParse(JSON.parse(JSON.stringify(form))).data).toEqual(form);
    expect(shape.safeParse({ variables: 3 }).success).toBe(false);
  });
  it.each([
    ["/variables/1/upper", "variables.1.upper"],
    ["/variables/0", "variables.0.parameter"],
    ["/goals/2/upper/unit", "goals.2.upper"],
    ["/goals/0/open_at", "goals.0.metric"],
    ["/scenarios/1/motor.mass", "scenarios"],
    ["/method/points", "options.points"],
    ["/experiments/0/input", null],
  ])("%s belongs to the field %s", (pointer, field) => expect(fieldOf(pointer)).toBe(field));
});
