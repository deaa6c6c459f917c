import { describe, expect, it } from "vitest";
import { inks } from "@/shared/charts/inks";
import { stroke } from "./palette";

type Triple = [number, number, number];
const COUNT = 6;
/** What is drawn on: the page, and the panel, of both themes (Mantine's dark-7 is the page of the dark one). */
const PAPER = { light: ["#ffffff", "#f6f8fa"], dark: ["#242424", "#1f2225"] };
const THEMES = [
  ["light", false],
  ["dark", true],
] as const;

/** Linear light of sRGB (IEC 61966-2-1). */
const linear = (hex: string) => [1, 3, 5].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255).map((c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4)) as Triple;
const times = (m: readonly Triple[], v: Triple) => m.map((row) => row[0] * v[0] + row[1] * v[1] + row[2] * v[2]) as Triple;

/** (L1 + 0.05) / (L2 + 0.05): WCAG 2.1, contrast ratio. */
function contrast(a: string, b: string): number {
  const [low, high] = [a, b].map((hex) => times([[0.2126, 0.7152, 0.0722]], linear(hex))[0]).sort((x, y) => x - y) as [number, number];
  return (high + 0.05) / (low + 0.05);
}

/** What somebody sees to whom one kind of cones is missing: Machado, Oliveira and Fernandes 2009, severity 1, in linear light. */
const SEEN: Record<string, Triple[]> = {
  everyone: [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ],
  protanopia: [
    [0.152286, 1.052583, -0.204868],
    [0.114503, 0.786281, 0.099216],
    [-0.003882, -0.048116, 1.051998],
  ],
  deuteranopia: [
    [0.367322, 0.860646, -0.227968],
    [0.280085, 0.672501, 0.047413],
    [-0.01182, 0.04294, 0.968881],
  ],
};

/** L* a* b* of linear light under D65. */
function lab(rgb: Triple): Triple {
  const xyz = times(
    [
      [0.4124564, 0.3575761, 0.1804375],
      [0.2126729, 0.7151522, 0.072175],
      [0.0193339, 0.119192, 0.9503041],
    ],
    rgb.map((c) => Math.min(1, Math.max(0, c))) as Triple,
  );
  const [x, y, z] = [xyz[0] / 0.95047, xyz[1], xyz[2] / 1.08883].map((t) => (t > 216 / 24389 ? Math.cbrt(t) : (24389 / 27 * t + 16) / 116)) as Triple;
  return [116 * y - 16, 500 * (x - y), 200 * (y - z)];
}

it("measures contrast as WCAG does", () => {
  expect(contrast("#ffffff", "#000000")).toBeCloseTo(21);
  // The grey that WCAG's readers know as the lightest one for text on white.
  expect(contrast("#767676", "#ffffff")).toBeCloseTo(4.54, 2);
});

describe.each(THEMES)("in the %s theme", (theme, dark) => {
  const colors = Array.from({ length: COUNT }, (_, i) => stroke(i, dark));

  it("every line stands out from its paper (3:1)", () => {
    for (const { color } of colors) for (const paper of PAPER[theme]) expect([color, paper, contrast(color, paper) >= 3]).toEqual([color, paper, true]);
  });

  it("what is written and marked in charts can be read", () => {
    const { ink, accent, mark } = inks(dark);
    for (const paper of PAPER[theme]) {
      expect(contrast(ink, paper)).toBeGreaterThanOrEqual(4.5);
      for (const color of [accent, mark]) expect(contrast(color, paper)).toBeGreaterThanOrEqual(3);
    }
  });

  it.each(Object.keys(SEEN))("no two lines look the same to %s: by colour, or by their dashes", (who) => {
    for (let i = 0; i < COUNT; i++) {
      for (let k = i + 1; k < COUNT; k++) {
        const [a, b] = [colors[i]!, colors[k]!].map(({ color }) => lab(times(SEEN[who]!, linear(color)))) as [Triple, Triple];
        const apart = Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
        expect([i, k, apart > 8]).toEqual([i, k, true]);
        expect(colors[i]!.dash).not.toEqual(colors[k]!.dash);
      }
    }
  });
});
