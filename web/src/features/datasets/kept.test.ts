import type { TFunction } from "i18next";
import { describe, expect, it } from "vitest";
import { curvesOf } from "./kept";

const t = ((key: string) => key) as unknown as TFunction;

describe("a kept result", () => {
  it("has a chart for each output, with a line for each variant, called by its values", () => {
    const result = { variants: [{ time: [0, 1], outputs: { y: [0, null] } }, { parameters: { "law.kp": 0.02, mass: { value: 5, unit: "kg" } }, time: [0, 2], outputs: { y: [0, 3], v: [1, 1] } }] };
    const charts = curvesOf("simulation", result, t);
    expect(charts.map(({ title }) => title)).toEqual(["y", "v"]);
    expect(charts[0]!.lines.map(({ label }) => label)).toEqual(["results.asIs", 'law.kp = 0.02, mass = {"value":5,"unit":"kg"}']);
    expect(charts[0]!.lines.map(({ y }) => [...y])).toEqual([[0, NaN], [0, 3]]);
    expect([...charts[1]!.lines[0]!.y]).toEqual([]);
  });
  it("has the units of its system, and where that is not known those of its peaks", () => {
    const result = { variants: [{ time: [0], outputs: { y: [0], v: [0] }, metrics: { y: { peak: { unit: "mm" } }, v: { peak: { unit: "m/s**2" } } } }] };
    expect(curvesOf("simulation", result, t, new Map([["y", "m"]])).map(({ y }) => y.unit)).toEqual(["m", "m/s²"]);
  });
  it("has magnitude in dB and phase in degrees over frequency", () => {
    const [magnitude, phase] = curvesOf("frequency_response", { variants: [{ frequency: [1, 10], magnitude: [1, 0.1], phase: [0, -Math.PI / 2] }] }, t);
    expect([...magnitude!.lines[0]!.y]).toEqual([0, -20]);
    expect([...phase!.lines[0]!.y]).toEqual([0, -90]);
  });
  it("of another kind has none", () => expect(curvesOf("influence", { variants: [] }, t)).toEqual([]));
});
