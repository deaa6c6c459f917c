import { expect, it } from "vitest";
import { resampled } from "./optimization/BeforeAfter";
import { fitRows, responseRows, panelAt } from "./results";
import { cellIn, placeIn, placesIn } from "./optimization/look";
import { flatOf, nearest, sliceOf, valuesAt } from "./optimization/map";
import { bestOf } from "./events";
import { endOf } from "./optimization/ends";
import { remaining } from "./JobClock";

it("the best so far is read from what a job says", () => {
  expect(bestOf("best after 12 evaluations: objective 0.628735, violation 1e-3 at kp = 4")).toEqual({ evaluation: 12, objective: 0.628735, violation: 0.001, values: { kp: 4 } });
  expect(bestOf("best after 2 evaluations: objective 1, violation 0 at law.kp = -4e-05, gain = 3")?.values).toEqual({ "law.kp": -4e-5, gain: 3 });
  expect(bestOf("best after 1 evaluations: objective nan, violation 0 at kp = 4")).toBeNull();
  expect(bestOf("sampling")).toBeNull();
});

it("curves are compared at the times of the later one", () => expect([...resampled(Float64Array.of(0, 1, 2), Float64Array.of(0, 10, 30), Float64Array.of(0, 0.5, 1.5, 5))]).toEqual([0, 5, 20, 30]));

it("values are addressed on the panel", () => expect(panelAt("sys_1", { kp: 2.5, "m.a": 1 })).toBe("/systems/sys_1/panel?s=kp%2Cm.a&p.kp=2.5&p.m.a=1&ref=1"));

it("a map of three variables is looked at in slices", () => {
  // 2 x 2 x 3, the first variable slowest: objective = 100 a + 10 b + c.
  const axes = { a: [1, 2], b: [1, 2], c: [1, 2, 3] };
  const objective = axes.a.flatMap((a) => axes.b.flatMap((b) => axes.c.map((c) => 100 * a + 10 * b + c)));
  const map = { axes, objective, violation: objective.map((v) => (v > 200 ? 1 : 0)) };
  expect(sliceOf(map, "c", "a", { b: 1 }).map((cell) => [cell.x, cell.y, cell.objective, cell.met])).toEqual([[0, 0, 121, true], [0, 1, 221, false], [1, 0, 122, true], [1, 1, 222, false], [2, 0, 123, true], [2, 1, 223, false]]);
  expect(nearest([1, 2, 4], 3.2)).toBe(2);
  expect(objective[flatOf(map, [1, 0, 2])]).toBe(213);
  expect(valuesAt(map, [1, 0, 2])).toEqual({ a: 2, b: 1, c: 3 });
  expect(["1,0,2", "1,0", "2,0,0", "1,,2", "x,0,0", "", null].map((text) => cellIn(text, map))).toEqual([[1, 0, 2], null, null, null, null, null, null]);
});

it("puts every fit beside what needs no model to reach it", () => {
  const rows = fitRows({ estimation: { y: { fit_percent: 95 } }, validation: { y: { fit_percent: 94 } }, baselines: { mean: { y: { fit_percent: 0 } } } }, { y: { fit_percent: 99 } });
  expect(rows.map((row) => [row.part, row.trivial, row.numbers.fit_percent])).toEqual([["estimation", false, 95], ["validation", false, 94], ["mean", true, 0], ["one_step", true, 99]]);
});

it("an address names places that there are", () => {
  expect(["0", "2", "3", "-1", "1.5", "", null].map((text) => placeIn(text, 3))).toEqual([0, 2, null, null, null, null, null]);
  expect(["2,0", "2,2,9", "", null].map((text) => placesIn(text, 3))).toEqual([[2, 0], [2], [0, 1, 2], [0, 1, 2]]);
});

it("shows measured frequency responses beside recordings", () => {
  const rows = responseRows([{ name: "sweep", outputs: { y: { fit_percent: 98, relative_error_percent: 2 } } }]);
  expect(rows.map((row) => [row.part, row.output, row.numbers.fit_percent])).toEqual([["frequency", "y · sweep", 98]]);
  expect(responseRows(undefined)).toEqual([]);
});

it("a value at an end of its range is told, on a range of any size", () => {
  const range = { lower: 1e-6, upper: 1e-4 };
  expect([1e-6, 1.0001e-6, 5e-5, 9.9999e-5, 1e-4].map((value) => endOf(value, range))).toEqual(["lower", "lower", null, "upper", "upper"]);
  expect([endOf(5, {}), endOf(5, { upper: 5 }), endOf(0, { lower: 0, upper: 10 })]).toEqual([null, "upper", "lower"]);
});

it("the time that is left goes by the share that is done, and is not guessed from nothing", () => {
  expect(remaining(30, 0.25)).toBe(90);
  expect([remaining(30, 0.01), remaining(1, 0.5), remaining(30, 1)]).toEqual([null, null, null]);
});
