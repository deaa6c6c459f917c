import { describe, expect, it } from "vitest";
import { curveOf, dampingGrid, dominant, locusOf, nearest, poleAt, type Pole } from "./locus";

/** 1 + K/(s (s + 2)): s = -1 ± √(1 - K). */
const second = (gain: number): Pole[] => {
  const root = Math.sqrt(Math.abs(1 - gain));
  return gain <= 1 ? [{ real: -1 + root, imag: 0 }, { real: -1 - root, imag: 0 }] : [{ real: -1, imag: root }, { real: -1, imag: -root }];
};
const range = (from: number, to: number, count: number) => Array.from({ length: count }, (_, i) => from + ((to - from) * i) / (count - 1));
/** Poles come in any order. */
const shuffled = (poles: Pole[], k: number) => (k % 2 === 0 ? poles : poles.toReversed());

describe("a root locus", () => {
  it("follows poles that cross on the real axis", () => {
    const values = range(0, 3, 31);
    const { branches } = locusOf("k", values, values.map((k, i) => shuffled([{ real: -1 - k, imag: 0 }, { real: -4 + k, imag: 0 }], i)));
    expect(branches).toHaveLength(2);
    const [one, other] = branches[0]!.re[0] === -1 ? [branches[0]!, branches[1]!] : [branches[1]!, branches[0]!];
    values.forEach((k, i) => {
      expect(one.re[i]).toBeCloseTo(-1 - k, 12);
      expect(other.re[i]).toBeCloseTo(-4 + k, 12);
    });
  });
  it("holds every pole once, through the point where they leave the real axis", () => {
    const values = range(0, 5, 101);
    const { branches } = locusOf("k", values, values.map((k, i) => shuffled(second(k), i)));
    expect(branches).toHaveLength(2);
    values.forEach((k, i) => {
      const real = branches.map(({ re }) => re[i]!).sort((a, b) => b - a);
      const imag = branches.map(({ im }) => im[i]!).sort((a, b) => b - a);
      expect(real[0]).toBeCloseTo(Math.max(...second(k).map((pole) => pole.real)), 12);
      expect(imag[0]).toBeCloseTo(Math.max(...second(k).map((pole) => pole.imag)), 12);
    });
    // Each line moves in small steps: 2√ΔK at the most, where they leave the axis.
    for (const { re, im } of branches) for (let i = 1; i < values.length; i++) expect(Math.hypot(re[i]! - re[i - 1]!, im[i]! - im[i - 1]!)).toBeLessThan(2 * Math.sqrt(0.05) + 1e-9);
  });
  it("begins and ends lines where there are more poles, or fewer", () => {
    const { branches } = locusOf("k", [0, 1, 2], [[{ real: -1, imag: 0 }], [{ real: -1, imag: 0 }, { real: -9, imag: 0 }], [{ real: -9, imag: 0 }]]);
    expect(branches.map(({ re }) => [...re])).toEqual([[-1, -1, NaN], [NaN, -9, -9]]);
    expect([...curveOf({ path: "k", values: [0, 1, 2], branches }).x]).toEqual([-1, -1, NaN, NaN, NaN, -9, -9, NaN]);
  });
});

describe("a value on a root locus", () => {
  const values = range(1.5, 5, 71);
  const locus = locusOf("k", values, values.map(second));
  const upper = locus.branches.findIndex(({ im }) => im[0]! > 0);
  it("is found from a point of the plane: K = 1 + (Im s)² on the line Re s = -1", () => {
    for (const imag of [0.8, 1.2, 1.9]) expect(nearest(locus, [-1, imag])!.value).toBeCloseTo(1 + imag ** 2, 2);
    expect(nearest(locus, [-1, 1])).toEqual(nearest(locus, [-0.5, 1]));
    expect(nearest(locus, [-1, 99])!.value).toBe(5);
  });
  it("has its pole, straight between those that are known", () => {
    expect(poleAt(locus, upper, 3)![1]).toBeCloseTo(Math.SQRT2, 4);
    expect(poleAt(locus, upper, 99)).toEqual([-1, 2]);
  });
  it("is taken hold of at the slowest pole that moves", () => {
    const with_others = locusOf("k", values, values.map((k) => [...second(k), { real: 0, imag: 0 }, { real: -8 - k, imag: 0 }]));
    const branch = dominant(with_others, 3)!;
    expect(poleAt(with_others, branch, 3)![1]).toBeCloseTo(Math.SQRT2, 4);
    expect(dominant(locusOf("k", [1, 2], [[{ real: -1, imag: 0 }], [{ real: -1, imag: 0 }]]), 1)).toBeNull();
  });
});

describe("the grid of a pole plot", () => {
  const lines = dampingGrid([-100, 20], [-60, 60]);
  it("has rays of equal damping ratio: ζ = -Re s/|s|", () => {
    for (const { x, y, text } of lines.filter((line) => line.text.startsWith("ζ"))) expect(-x[0]! / Math.hypot(x[0]!, y[0]!)).toBeCloseTo(Number(text.slice(2)), 12);
  });
  it("has arcs of equal natural frequency: ωn = |s|, in round numbers", () => {
    const arcs = lines.filter((line) => !line.text.startsWith("ζ"));
    expect(arcs.map(({ x, y }) => Math.round(1e6 * Math.hypot(x[7]!, y[7]!)) / 1e6)).toEqual([20, 40, 60, 80, 100]);
    for (const { x, y } of arcs) for (let i = 1; i < x.length; i++) expect(Math.hypot(x[i]!, y[i]!)).toBeCloseTo(Math.hypot(x[0]!, y[0]!), 9);
  });
  it("is there for the left half of the plane only", () => expect(dampingGrid([1, 5], [-2, 2])).toEqual([]));
});
