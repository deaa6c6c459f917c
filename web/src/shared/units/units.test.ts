import { describe, expect, it } from "vitest";
import { formatMetric, formatNumber, formatQuantity, named, prettyUnit } from "./format";
import { inUnit } from "./convert";
import { readEntry } from "./number";

describe("entries", () => {
  it.each([
    ["2.4k", "ohm", 2400],
    ["330 m", "ohm", 0.33],
    ["330 mΩ", "ohm", 0.33],
    ["1,5", "s", 1.5],
    ["-3e-2", "", -0.03],
    ["5 m", "m", 5],
    ["5 mm", "m", 0.005],
    ["7 µ", "F", 7e-6],
    [".5", "", 0.5],
  ])("%s of a value in %s", (text, unit, value) => expect(readEntry(text, unit)).toEqual({ kind: "number", value }));
  it("leaves other units to the service", () => expect(readEntry("65 cm**2", "m**2")).toEqual({ kind: "quantity", value: 65, unit: "cm**2" }));
  it.each([
    ["1,000", "1000", "1.000"],
    ["-12,500 m", "-12500", "-12.500"],
  ])("%s may be two numbers", (text, thousands, decimal) => expect(readEntry(text, "m")).toEqual({ kind: "wrong", either: { thousands, decimal } }));
  it.each([
    ["0,125", 0.125],
    ["1,50", 1.5],
    ["1000,125", 1000.125],
  ])("%s is one number", (text, value) => expect(readEntry(text)).toEqual({ kind: "number", value }));
  it("takes expressions", () => expect(readEntry(" =kp/20 ")).toEqual({ kind: "expression", text: "=kp/20" }));
  it.each(["", "abc", "=", "3..2", "1 2", "1e999", "--1"])("refuses %j", (text) => expect(readEntry(text).kind).toBe("wrong"));
});

describe("units typed for another one", () => {
  it.each([
    [100, "Hz", "rad/s", 200 * Math.PI],
    [3000, "rpm", "rad/s", 100 * Math.PI],
    [90, "°", "rad", Math.PI / 2],
    [2, "min", "s", 120],
    [6, "bar", "Pa", 6e5],
    [5, "%", "1", 0.05],
  ])("%d %s in %s", (value, written, unit, expected) => expect(inUnit(value, written, unit)).toBeCloseTo(expected, 9));
  it.each([
    ["Hz", "s"],
    ["furlong", "m"],
    ["%", "m"],
  ])("%s is nothing in %s", (written, unit) => expect(inUnit(1, written, unit)).toBeNull());
});

describe("shown values", () => {
  it.each([
    [0.0021, "s", "2.1", "ms"],
    [1000, "s", "1000", "s"],
    [0.33, "ohm", "330", "mΩ"],
    [5e5, "Pa", "500", "kPa"],
    [0.0065, "m**2", "0.0065", "m²"],
    [0, "V", "0", "V"],
  ])("%d %s", (value, unit, text, shown) => expect(formatQuantity(value, unit)).toEqual({ text, unit: shown }));
  it("writes signs and exponents as a book does", () => expect(formatNumber(-1.25e-7)).toBe("−1.25e−7"));
  it("names infinity", () => expect(formatNumber(Infinity)).toBe("∞"));
  it("speaks of margins in degrees and decibel", () => {
    expect(formatMetric("phase_margin", Math.PI / 3, "rad")).toEqual({ text: "60", unit: "°" });
    expect(formatMetric("gain_margin", 10, "1")).toEqual({ text: "20", unit: "dB" });
    expect(formatMetric("overshoot", 0.0873, "1")).toEqual({ text: "8.73", unit: "%" });
  });
  it("prints what is below rounding as 0, where sizes are about 1", () => {
    expect(formatMetric("overshoot", 1.56e-24, "1")).toEqual({ text: "0", unit: "%" });
    expect(formatMetric("phase_margin", -4e-17, "rad")).toEqual({ text: "0", unit: "°" });
    expect(formatMetric("gain_margin", 1 + 2 ** -52, "1")).toEqual({ text: "0", unit: "dB" });
    // A leakage of this size is none.
    expect(formatQuantity(1.2e-13, "m**5/(N*s)").text).toBe("1.2e−13");
  });
  it("prints units", () => expect(prettyUnit("m**3/(s*Pa)")).toBe("m³/(s·Pa)"));
});

it("an axis is called by its name and its unit, where it has one", () => expect([named("motor.leakage", "m**5/(N*s)"), named("law.kp", "1")]).toEqual(["motor.leakage [m⁵/(N·s)]", "law.kp"]));
