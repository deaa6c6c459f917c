import { describe, expect, it } from "vitest";
import { nearest } from "./locus";
import { gripAt, pointAt, wayOf, type Family } from "./pull";

const logarithmic = (from: number, to: number, count: number) => Array.from({ length: count }, (_, i) => from * (to / from) ** (i / (count - 1)));
const frequency = logarithmic(0.01, 100, 121);
const values = logarithmic(1, 25, 41);

/** K/(s (s + 2)) at s = jω: |L| = K/(ω √(ω² + 4)), arg L = -90° - atan(ω/2). */
const gainAt = (k: number, w: number) => k / (w * Math.hypot(w, 2));
const phaseAt = (w: number) => -90 - (Math.atan(w / 2) * 180) / Math.PI;
const curve = (k: number) => ({ frequency, magnitude: frequency.map((w) => 20 * Math.log10(gainAt(k, w))), phase: frequency.map(phaseAt) });
const family: Family = {
  path: "k",
  values,
  frequency,
  responses: values.map((k) => ({ re: frequency.map((w) => gainAt(k, w) * Math.cos((phaseAt(w) * Math.PI) / 180)), im: frequency.map((w) => gainAt(k, w) * Math.sin((phaseAt(w) * Math.PI) / 180)) })),
};

describe("a curve that is pulled", () => {
  it("is held at its crossover, else where its gain is nearest to 1", () => {
    expect(gripAt(curve(5), { phase: { frequency: 1.7, at: -130, turn: -180 }, gain: null })).toBe(1.7);
    // ω √(ω² + 4) = 5 at ω = √(√29 - 2)
    expect(gripAt(curve(5), null)! / Math.sqrt(Math.sqrt(29) - 2)).toBeCloseTo(1, 1);
    expect(gripAt({ frequency: [1, 2], magnitude: [NaN, NaN], phase: [NaN, NaN] }, null)).toBeNull();
  });
  it("has its point in each plane", () => {
    const at = 1.234;
    expect(pointAt(curve(5), at, "bode")![1]).toBeCloseTo(20 * Math.log10(gainAt(5, at)), 2);
    expect(pointAt(curve(5), at, "nichols")![0]).toBeCloseTo(phaseAt(at), 1);
    const [re, im] = pointAt(curve(5), at, "nyquist")!;
    expect(Math.hypot(re, im)).toBeCloseTo(gainAt(5, at), 2);
  });
  it("goes through the point that it is pulled to: the gain is what that takes", () => {
    for (const k of [2, 7, 20]) {
      for (const at of [0.3, 1.234, 8]) {
        const up = nearest(wayOf(family, at, "bode", 0), [0, 20 * Math.log10(gainAt(k, at))])!;
        expect(up.value / k).toBeCloseTo(1, 2);
        const chart = nearest(wayOf(family, at, "nichols", phaseAt(at) - 360), [phaseAt(at) - 360, 20 * Math.log10(gainAt(k, at))])!;
        expect(chart.value / k).toBeCloseTo(1, 2);
        const radians = (phaseAt(at) * Math.PI) / 180;
        const out = nearest(wayOf(family, at, "nyquist", 0), [gainAt(k, at) * Math.cos(radians), gainAt(k, at) * Math.sin(radians)])!;
        expect(out.value / k).toBeCloseTo(1, 2);
      }
    }
  });
  it("stops at the ends of the parameter's travel", () => {
    expect(nearest(wayOf(family, 1, "bode", 0), [0, 300])!.value).toBeCloseTo(25, 9);
    expect(nearest(wayOf(family, 1, "bode", 0), [0, -300])!.value).toBeCloseTo(1, 9);
  });
  it("keeps the turns of the curve that is drawn", () => {
    const way = wayOf(family, 2, "nichols", phaseAt(2) + 720);
    expect(way.branches[0]!.re[0]).toBeCloseTo(phaseAt(2) + 720, 1);
    expect(way.branches[0]!.re[40]).toBeCloseTo(phaseAt(2) + 720, 1);
  });
});
