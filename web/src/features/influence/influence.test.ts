import { expect, it } from "vitest";
import { barsOf, beyondRounding, changeIn, columnIn, sizeOf, tornado } from "./table";

it("a tornado begins with the longest bar", () => expect(tornado([{ name: "a", value: 1 }, { name: "b", value: null }, { name: "c", value: -3 }])).toEqual([{ name: "c", value: -3 }, { name: "a", value: 1 }]));

it("colours see small influences", () => {
  expect(sizeOf(0.25, 1)).toBe(0.5);
  expect(sizeOf(Infinity, 1)).toBe(0);
});

it("the table is read by rows and by columns", () => {
  const cells: Record<string, Record<string, number | null>> = { overshoot: { kp: 1, mass: -2 }, bandwidth: { kp: 3, mass: 0.5 }, phase_margin: { kp: null, mass: 0 } };
  const table = { metrics: Object.keys(cells), parameters: ["kp", "mass"], row: "overshoot" };
  const value = (metric: string, parameter: string) => cells[metric]![parameter]!;
  expect(barsOf(value, { ...table, column: null })).toEqual([{ name: "mass", value: -2 }, { name: "kp", value: 1 }]);
  expect(barsOf(value, { ...table, column: "kp" })).toEqual([{ name: "bandwidth", value: 3 }, { name: "overshoot", value: 1 }]);
});

it("an address reads a column that the table has", () => expect(["kp", "gone", "", null].map((text) => columnIn(text, ["kp", "mass"]))).toEqual(["kp", null, null, null]));

it("an address holds a change that the slider has", () => expect(["25", "-50", "0", "51", "much", null].map(changeIn)).toEqual([25, -50, 10, 10, 10, 10]));

it("what is below rounding is nothing", () => expect([1.56e-24, -3e-10, 2e-4, -0.5, Infinity].map(beyondRounding)).toEqual([0, 0, 2e-4, -0.5, Infinity]));
