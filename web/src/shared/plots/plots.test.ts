import { describe, expect, it } from "vitest";
import { csvOf } from "./export";
import { axisWidth, clamped, decadeText, equalRanges, extent, logRange, padded, tickTexts, withReturns } from "./ranges";

describe("ranges", () => {
  it("passes over what is no number", () => expect(extent([[1, NaN, 3], [-2]])).toEqual([-2, 3]));
  it("knows nothing of nothing", () => expect(extent([[NaN], []])).toBeNull());
  it("leaves air", () => expect(padded([0, 1], 0.1)).toEqual([-0.1, 1.1]));
  it("puts a constant into the middle", () => expect(padded([5, 5])).toEqual([4.5, 5.5]));
  it("sees a curve of nothing but noughts as flat", () => expect(padded([0, 0])).toEqual([-1, 1]));
  it("clamps, unless nothing is left", () => {
    expect(clamped([-200, 20], [-60, 100])).toEqual([-60, 20]);
    expect(clamped([-200, -100], [-60, 100])).toEqual([-200, -100]);
  });
  it("follows a curve under the limit as far as it comes back, and cuts what goes on falling", () => {
    expect(withReturns([[0, -90, -70, -85, -300]], [-80, 120])).toEqual([-90, 120]);
    expect(withReturns([[0, -60, -90, -400]], [-80, 120])).toEqual([-80, 120]);
    expect(withReturns([[-90, -100], [NaN, NaN], []], [-80, 120])).toEqual([-80, 120]);
    // A zero on the axis would take the limit to infinity.
    expect(withReturns([[0, -2000, 0]], [-80, 120])).toEqual([-280, 120]);
  });
  it("draws a circle as one", () => {
    const { x, y } = equalRanges([-1, 1], [-1, 1], 400, 200);
    expect((x[1] - x[0]) / 400).toBeCloseTo((y[1] - y[0]) / 200);
    expect(y).toEqual([-1, 1]);
  });
});

describe("CSV", () => {
  it("has units in the header and gaps where there is nothing", () => {
    const text = csvOf({ x: { label: "time", unit: "s" }, y: { label: "speed", unit: "rad/s" }, series: [{ label: 'R "a"', color: "", dash: [] }] }, [{ x: [0, 1], y: [2, NaN] }]);
    expect(text).toBe('"R ""a"": time [s]","R ""a"": speed [rad/s]"\n0,2\n1,\n');
  });
  it("leaves out what cannot be seen", () => {
    const spec = { x: { label: "t", unit: "" }, y: { label: "y", unit: "" }, series: [{ label: "now", color: "", dash: [] }, { label: "earlier", color: "", dash: [], faint: true }] };
    expect(csvOf(spec, [{ x: [0], y: [1] }, { x: [0], y: [NaN] }])).toBe('"now: t","now: y"\n0,1\n');
  });
});

describe("ticks", () => {
  it.each([
    [[0, 0.0002, 0.0004], 0.0002, ["0", "2e-4", "4e-4"]],
    [[0, 0.25, 0.5], 0.25, ["0.00", "0.25", "0.50"]],
    [[-10, 0, 10], 10, ["-10", "0", "10"]],
    [[0, 2e-6, 4e-6], 2e-6, ["0", "2e-6", "4e-6"]],
    [[0, 2.5e6], 2.5e6, ["0", "2.5e6"]],
    [[12.3865, 12.38675], 0.00025, ["12.38650", "12.38675"]],
  ])("%j", (splits, step, texts) => expect(tickTexts(splits, step)).toEqual(texts));
});

it("an axis is as wide as its labels, and not less than others", () => {
  expect(axisWidth(null, 58)).toBe(58);
  expect(axisWidth(["0.02", "0.04"], 58)).toBe(58);
  expect(axisWidth(["12.38650", "12.38675"], 58)).toBe(16 + 8 * 7);
});

it("decades are short", () => expect([0.001, 0.1, 700, 1000, 1e4, 7e4].map(decadeText)).toEqual(["1e-3", "0.1", "700", "1000", "1e4", "7e4"]));
it.each([
  [[1.05, 1570], [1, 2000]],
  [[0.346, 9642], [0.3, 1e4]],
  [[0.001, 1000], [0.001, 1000]],
  [[0.3, 0.7], [0.3, 0.7]],
  [[5, 5], [0.5, 50]],
] as const)("a logarithmic axis of %j ends with whole digits and not with an empty decade", (range, ends) => expect(logRange([...range])).toEqual(ends));
