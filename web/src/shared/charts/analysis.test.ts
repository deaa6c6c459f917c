import { expect, it } from "vitest";
import { optionOf, pairs, type AnalysisSpec } from "./analysis";

const spec: AnalysisSpec = {
  title: "magnitude",
  x: { label: "ω", unit: "rad/s", log: true },
  y: { label: "|G|", unit: "m/N", log: true },
  lines: [{ label: "measured", x: [0, 1, 10], y: [5, 2, NaN], band: { lower: [4, 1, 0], upper: [6, 3, 1] } }],
  marks: [{ y: 1, label: "limit" }],
};

it("leaves out what a logarithmic axis has no place for", () => expect(pairs(spec, spec.lines[0]!)).toEqual([[1, 2], [10, null]]));

it("puts a band behind its line, with names and units on the axes", () => {
  const option = optionOf(spec, false) as { series: { type: string; data: unknown[] }[]; xAxis: { name: string; min: number; max: number }; yAxis: { name: string } };
  expect(option.series.map((series) => series.type)).toEqual(["custom", "line", "line"]);
  expect(option.series[0]!.data).toEqual([[1, 1, 3]]);
  // The line of 0 rad/s is not there; the axis ends where the others do.
  expect([option.xAxis.min, option.xAxis.max]).toEqual([1, 10]);
  expect([option.xAxis.name, option.yAxis.name]).toEqual(["ω [rad/s]", "|G| [m/N]"]);
});
