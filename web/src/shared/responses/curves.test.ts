import { describe, expect, it } from "vitest";
import { boundAt, holds, zoneOf, type Facts, type PanelGoal } from "./goals";
import { marginsOf } from "./margins";
import { frequenciesOf, spectrumOf } from "./spectrum";

describe("margins", () => {
  /** K / (s (s + 1) (s + 2)): phase -180° at ω = √2, gain K/6 there. */
  const third = (gain: number, n = 2000) => {
    const frequency = Float32Array.from({ length: n }, (_, i) => 10 ** (-2 + (4 * i) / (n - 1)));
    const magnitude = frequency.map((w) => 20 * Math.log10(gain / (w * Math.hypot(1, w) * Math.hypot(2, w))));
    const phase = frequency.map((w) => ((-Math.PI / 2 - Math.atan(w) - Math.atan(w / 2)) * 180) / Math.PI);
    return marginsOf(frequency, magnitude, phase);
  };
  it("are read where the phase is half a turn", () => {
    const { gain } = third(1);
    expect(gain!.frequency).toBeCloseTo(Math.SQRT2, 3);
    expect(gain!.magnitude).toBeCloseTo(20 * Math.log10(1 / 6), 2);
  });
  it("are read where the gain is 1", () => {
    // At K = 6 the loop is on its edge: both margins vanish at √2.
    const { phase } = third(6);
    expect(phase!.frequency).toBeCloseTo(Math.SQRT2, 2);
    expect(phase!.at - phase!.turn).toBeCloseTo(0, 1);
  });
  it("do not exist for a loop that never crosses", () => {
    const frequency = Float32Array.of(1, 10, 100);
    expect(marginsOf(frequency, Float32Array.of(-10, -20, -30), Float32Array.of(-10, -20, -30))).toEqual({ phase: null, gain: null });
  });
});

describe("spectra", () => {
  it("show the amplitude of a sine at its frequency", () => {
    // 32 periods in 1024 samples: a line of the transform, where Hann's window loses nothing.
    const level = spectrumOf(Float32Array.from({ length: 1024 }, (_, i) => 5 + 3 * Math.sin((2 * Math.PI * 32 * i) / 1023)));
    const frequency = frequenciesOf(1024, 1 / 1023);
    const k = level.indexOf(Math.max(...level));
    expect(level[k]).toBeCloseTo(20 * Math.log10(3), 1);
    expect(Math.abs(frequency[k]! - 32)).toBeLessThan(0.6);
  });
  it("of a constant have no level", () => expect(Math.max(...spectrumOf(new Float32Array(1000).fill(7)))).toBe(-200));
  it("of nothing are nothing", () => expect(spectrumOf([null, null, null])[0]).toBeNaN());
});

describe("goals", () => {
  const facts: Facts = { time: Float32Array.of(0, 1, 2), start: 0, final: 10, tenth: 0.1, margins: { phase: { frequency: 5, at: -130, turn: -180 }, gain: { frequency: 20, magnitude: -12, turn: -180 } }, statically: 0, reach: 30 };
  const goals: PanelGoal[] = [
    { metric: "overshoot", bound: "upper", value: 0.05 },
    { metric: "undershoot", bound: "upper", value: 0.1 },
    { metric: "peak", bound: "upper", value: 12 },
    { metric: "rise_time", bound: "upper", value: 0.4 },
    { metric: "settling_time", bound: "upper", value: 1.2 },
    { metric: "response_time", bound: "upper", value: 1.1 },
    { metric: "bandwidth", bound: "lower", value: 7 },
    { metric: "phase_margin", bound: "lower", value: 0.8 },
    { metric: "gain_margin", bound: "lower", value: 3 },
    { metric: "sensitivity_peak", bound: "upper", value: 1.8 },
    { metric: "damping_ratio", bound: "lower", value: 0.6 },
  ];
  it.each(goals)("$metric: where its zone is taken is where its bound is", (goal) => {
    const zone = zoneOf(goal, facts, "", "")!;
    expect(boundAt(goal, zone.handle!.at, facts)).toBeCloseTo(goal.value, 9);
  });
  it("forbid what lies beyond the overshoot", () => expect(zoneOf(goals[0]!, facts, "", "")!.shapes).toEqual([{ kind: "box", x: [-Infinity, Infinity], y: [10.5, Infinity] }]));
  it("forbid downwards where the curve goes down", () => expect(zoneOf(goals[0]!, { ...facts, final: -10 }, "", "")!.shapes).toEqual([{ kind: "box", x: [-Infinity, Infinity], y: [-Infinity, -10.5] }]));
  it("leave a disc about the critical point", () => expect(zoneOf(goals[9]!, facts, "", "")!.shapes).toEqual([{ kind: "disc", center: [-1, 0], radius: 1 / 1.8 }]));
  it("have no zone where the loop has no crossover", () => expect(zoneOf(goals[7]!, { ...facts, margins: null }, "", "")).toBeNull());
  it("hold or not", () => {
    expect(holds(goals[0]!, 0.04)).toBe(true);
    expect(holds(goals[7]!, 0.7)).toBe(false);
    expect(holds(goals[7]!, null)).toBeNull();
    expect(holds({ metric: "gain_margin", bound: "lower", value: 2 }, 0.12)).toBe(true);
    expect(holds({ metric: "phase_margin", bound: "lower", value: 0.8 }, -0.9)).toBe(true);
  });
});
