import { describe, expect, it } from "vitest";
import { bodyOf, curlOf, pythonOf, readScenarios } from "./problem";
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

describe("scenarios", () => {
  it("that cannot be read are none", () => expect(readScenarios("m : 5")).toBeUndefined());
  it("may be left out", () => expect(readScenarios("\n")).toEqual([]));
});

it("is copied as Python and for a shell", () => {
  const body = bodyOf({ ...form, scenarios: "" }, "sys_1", domains);
  expect(pythonOf(body, "http://host")).toContain('job = client.optimize(\n    "sys_1",\n    variables=[\n        {\n            "parameter": "kp",');
  expect(curlOf({ name: "it's" }, "http://host")).toContain(`'{"name":"it'\\''s"}'`);
});
