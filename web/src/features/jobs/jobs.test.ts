import { expect, it } from "vitest";
import { resampled } from "./OptimizationView";
import { panelAt } from "./results";
import { bestOf } from "./events";

it("the best so far is read from what a job says", () => {
  expect(bestOf("best after 12 evaluations: objective 0.628735, violation 1e-3 at kp = 4")).toEqual({ evaluation: 12, objective: 0.628735, violation: 0.001 });
  expect(bestOf("best after 1 evaluations: objective nan, violation 0 at kp = 4")).toBeNull();
  expect(bestOf("sampling")).toBeNull();
});

it("curves are compared at the times of the later one", () => expect([...resampled(Float64Array.of(0, 1, 2), Float64Array.of(0, 10, 30), Float64Array.of(0, 0.5, 1.5, 5))]).toEqual([0, 5, 20, 30]));

it("values are addressed on the panel", () => expect(panelAt("sys_1", { kp: 2.5, "m.a": 1 })).toBe("/systems/sys_1/panel?s=kp%2Cm.a&p.kp=2.5&p.m.a=1&ref=1"));
