import { describe, expect, it } from "vitest";
import { mCircle, nicholsChart } from "./nichols";

const DEGREE = Math.PI / 180;

describe("M-circles", () => {
  it.each([-20, -3, 0, 1, 6])("hold the loops whose closed loop has a gain of %d dB", (level) => {
    const { phase, magnitude } = mCircle(level, 41);
    phase.forEach((angle, i) => {
      const size = 10 ** (magnitude[i]! / 20);
      const [re, im] = [size * Math.cos(angle * DEGREE), size * Math.sin(angle * DEGREE)];
      expect(20 * Math.log10(size / Math.hypot(1 + re, im))).toBeCloseTo(level, 8);
      expect(angle).toBeGreaterThan(-360);
      expect(angle).toBeLessThanOrEqual(0);
    });
  });
  it("lie about M²/(1 - M²) with the radius M/|1 - M²| in Nyquist's plane", () => {
    // K. Ogata, Modern Control Engineering, 5th ed., section 7-8.
    const gain = 10 ** (3 / 20);
    const { phase, magnitude } = mCircle(3, 33);
    const [center, radius] = [gain ** 2 / (1 - gain ** 2), gain / Math.abs(1 - gain ** 2)];
    phase.forEach((angle, i) => {
      const size = 10 ** (magnitude[i]! / 20);
      expect(Math.hypot(size * Math.cos(angle * DEGREE) - center, size * Math.sin(angle * DEGREE))).toBeCloseTo(radius, 8);
    });
  });
  it("of 0 dB is the line on which the real part of the loop is -1/2", () => {
    const { phase, magnitude } = mCircle(0, 33);
    phase.forEach((angle, i) => expect(10 ** (magnitude[i]! / 20) * Math.cos(angle * DEGREE)).toBeCloseTo(-0.5, 8));
  });
  it("run on without a jump", () => {
    for (const level of [-12, 0, 6]) {
      const { phase } = mCircle(level);
      for (let i = 1; i < phase.length; i++) expect(Math.abs(phase[i]! - phase[i - 1]!)).toBeLessThan(30);
    }
  });
});

describe("the chart", () => {
  it("repeats them every turn, with their names in sight", () => {
    const once = nicholsChart([-360, 0], [-40, 40]);
    const twice = nicholsChart([-720, 0], [-40, 40]);
    expect(once.map(({ text }) => text)).toContain("6 dB");
    expect(twice.filter(({ text }) => text === "6 dB")).toHaveLength(2);
    for (const { at } of once) {
      expect(at[0]).toBeGreaterThan(-360);
      expect(at[0]).toBeLessThan(0);
      expect(Math.abs(at[1])).toBeLessThan(40);
    }
  });
});
