import type { ChartLine, Curve, Point } from "@/shared/plots/types";
import { formatNumber } from "@/shared/units/format";

export interface Pole {
  real: number;
  imag: number;
}

/** The poles of a closed loop over the values of one parameter, as lines; NaN where a line does not exist. */
export interface Locus {
  path: string;
  /** Rising. */
  values: number[];
  branches: { re: Float64Array; im: Float64Array }[];
}

/**
 * Lines of poles: each pole goes on from the one that it is nearest to, where its line would go on straight. The nearest pair is joined first.
 */
export function locusOf(path: string, values: number[], poles: readonly (readonly Pole[])[]): Locus {
  const branches: Locus["branches"] = [];
  poles.forEach((found, k) => {
    const open = branches.map((branch, b) => ({ b, at: expected(branch, k) })).filter(({ at }) => at !== null);
    const pairs = found.flatMap(({ real, imag }, pole) => open.map(({ b, at }) => ({ b, pole, far: Math.hypot(real - at![0], imag - at![1]) }))).sort((a, b) => a.far - b.far);
    const [joined, taken] = [new Map<number, number>(), new Set<number>()];
    for (const { b, pole } of pairs) {
      if (joined.has(pole) || taken.has(b)) continue;
      joined.set(pole, b);
      taken.add(b);
    }
    found.forEach(({ real, imag }, pole) => {
      const b = joined.get(pole) ?? branches.push({ re: new Float64Array(values.length).fill(NaN), im: new Float64Array(values.length).fill(NaN) }) - 1;
      branches[b]!.re[k] = real;
      branches[b]!.im[k] = imag;
    });
  });
  return { path, values, branches };
}

/** Where a line goes on to at value `k`, straight on from the two before; null where it has ended. */
function expected({ re, im }: Locus["branches"][number], k: number): Point | null {
  if (k === 0 || Number.isNaN(re[k - 1]!)) return null;
  if (k === 1 || Number.isNaN(re[k - 2]!)) return [re[k - 1]!, im[k - 1]!];
  return [2 * re[k - 1]! - re[k - 2]!, 2 * im[k - 1]! - im[k - 2]!];
}

/** All lines as one curve with gaps between them. */
export function curveOf({ branches }: Locus): Curve {
  const gap = (lines: Float64Array[]) => Float64Array.from(lines.flatMap((line) => [...line, NaN]));
  return { x: gap(branches.map(({ re }) => re)), y: gap(branches.map(({ im }) => im)) };
}

/** The place of the parameter among the values, with the part of the way to the next one. */
function placeOf(values: readonly number[], value: number): number {
  const last = values.length - 1;
  if (value <= values[0]!) return 0;
  const next = values.findIndex((one) => one >= value);
  return next < 0 ? last : next - 1 + (value - values[next - 1]!) / (values[next]! - values[next - 1]!);
}

/** Where a branch is at a value, straight between those that are known; null outside of it. */
export function poleAt({ values, branches }: Locus, branch: number, value: number): Point | null {
  const place = placeOf(values, value);
  const k = Math.min(Math.floor(place), values.length - 2);
  const between = (line: Float64Array) => (place === k ? line[k]! : line[k]! + (place - k) * (line[k + 1]! - line[k]!));
  const { re, im } = branches[branch]!;
  const at: Point = [between(re), between(im)];
  return at.every(Number.isFinite) ? at : null;
}

/** The branch that is taken hold of: of those that move, in the upper half of the plane, the slowest. */
export function dominant(locus: Locus, value: number): number | null {
  const size = Math.max(...locus.branches.flatMap(({ re, im }) => [...re].map((real, k) => Math.hypot(real, im[k]!) || 0)));
  let best: { branch: number; re: number } | null = null;
  locus.branches.forEach((branch, b) => {
    const at = poleAt(locus, b, value);
    const moves = [branch.re, branch.im].some((line) => Math.max(...line) - Math.min(...line) > 1e-6 * size);
    if (at && moves && at[1] >= -1e-9 * size && (best === null || at[0] > best.re)) best = { branch: b, re: at[0] };
  });
  return (best as { branch: number } | null)?.branch ?? null;
}

/** The value whose pole is nearest to a point of the plane, with its branch. */
export function nearest({ values, branches }: Locus, [x, y]: Point): { value: number; branch: number } | null {
  let best: { value: number; branch: number; far: number } | null = null;
  for (let branch = 0; branch < branches.length; branch++) {
    const { re, im } = branches[branch]!;
    for (let k = 0; k + 1 < values.length; k++) {
      const [dx, dy] = [re[k + 1]! - re[k]!, im[k + 1]! - im[k]!];
      const length = dx * dx + dy * dy;
      const part = length > 0 ? Math.min(1, Math.max(0, ((x - re[k]!) * dx + (y - im[k]!) * dy) / length)) : 0;
      const far = Math.hypot(x - re[k]! - part * dx, y - im[k]! - part * dy);
      if (far < (best?.far ?? Infinity)) best = { value: values[k]! + part * (values[k + 1]! - values[k]!), branch, far };
    }
  }
  return best && { value: best.value, branch: best.branch };
}

const DAMPING = [0.1, 0.3, 0.5, 0.7, 0.9];
const ARC = 60;

/** Lines of equal damping ratio ζ and of equal natural frequency ωn in the left half of the plane: s = -ζ ωn ± j ωn √(1 - ζ²). */
export function dampingGrid(x: [number, number], y: [number, number]): ChartLine[] {
  if (x[0] >= 0) return [];
  const reach = Math.hypot(x[0], Math.max(Math.abs(y[0]), Math.abs(y[1])));
  const seen = ([a, b]: Point) => a > x[0] + 0.05 * (x[1] - x[0]) && a < x[1] && b > y[0] + 0.06 * (y[1] - y[0]) && b < y[1] - 0.08 * (y[1] - y[0]);
  const found: ChartLine[] = [];
  for (const damping of DAMPING) {
    const [a, b] = [-damping, Math.sqrt(1 - damping ** 2)];
    // As far out as can be seen.
    let out = reach;
    while (out > reach / 100 && !seen([a * out, b * out])) out *= 0.98;
    found.push({ x: [a * reach, 0, a * reach], y: [b * reach, 0, -b * reach], text: `ζ ${damping}`, at: [a * out, b * out] });
  }
  for (const natural of roundSteps(reach)) {
    const angles = Array.from({ length: ARC + 1 }, (_, i) => Math.PI * (0.5 + i / ARC));
    const at = [0.52, 0.96].map((part): Point => [natural * Math.cos(Math.PI * part), natural * Math.sin(Math.PI * part)]).find(seen);
    found.push({ x: angles.map((angle) => natural * Math.cos(angle)), y: angles.map((angle) => natural * Math.sin(angle)), text: at ? `ωn ${natural < 1e6 ? Number(natural.toPrecision(6)) : formatNumber(natural, 3)}` : "", at: at ?? [0, 0] });
  }
  return found;
}

/** Three to six multiples of 1, 2 or 5 times a power of ten, up to `reach`. */
function roundSteps(reach: number): number[] {
  const power = 10 ** Math.floor(Math.log10(reach / 3));
  const step = [5, 2, 1].map((one) => one * power).find((one) => reach / one >= 3)!;
  return Array.from({ length: Math.floor(reach / step) }, (_, i) => (i + 1) * step);
}
