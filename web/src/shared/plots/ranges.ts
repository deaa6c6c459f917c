import type { Curve, Numbers } from "./types";

export type Range = [number, number];

export function extent(values: Iterable<Numbers>): Range | null {
  let low = Infinity;
  let high = -Infinity;
  for (const array of values) {
    for (let i = 0; i < array.length; i++) {
      const value = array[i]!;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  return low <= high && Number.isFinite(low) && Number.isFinite(high) ? [low, high] : null;
}

/** A range with air around the curves; a constant curve lies in its middle. */
export function padded(range: Range | null, part = 0.06): Range {
  if (range === null) return [0, 1];
  const [low, high] = range;
  const span = high - low;
  const air = span > 1e-12 * Math.max(Math.abs(low), Math.abs(high)) ? span * part : Math.abs(high) * 0.1 || 1;
  return [low - air, high + air];
}

export function clamped(range: Range, limits?: Range): Range {
  if (!limits) return range;
  const low = Math.max(range[0], limits[0]);
  const high = Math.min(range[1], limits[1]);
  return low < high ? [low, high] : range;
}

/**
 * The limits with the lower one taken down, at most `furthest` times as far as they reach, to the lowest place from which a curve comes
 * back: what is cut off goes on falling, and nothing beyond the cut returns as an island.
 */
export function withReturns(curves: readonly Numbers[], [low, high]: Range, furthest = 2): Range {
  let lowest = low;
  for (const curve of curves) {
    let last = curve.length - 1;
    while (last >= 0 && !(curve[last]! >= low)) last--;
    // Beneath the lower limit from the first on, or all within: nothing comes back.
    for (let i = 0; i < last; i++) if (curve[i]! < lowest) lowest = curve[i]!;
  }
  return [Math.max(lowest, high - furthest * (high - low)), high];
}

/** Both ranges for a plane of `width` by `height` pixels in which a circle is a circle. */
export function equalRanges(x: Range, y: Range, width: number, height: number): { x: Range; y: Range } {
  const unit = Math.max((x[1] - x[0]) / Math.max(width, 1), (y[1] - y[0]) / Math.max(height, 1));
  const about = (range: Range, pixels: number): Range => {
    const middle = (range[0] + range[1]) / 2;
    return [middle - (unit * pixels) / 2, middle + (unit * pixels) / 2];
  };
  return { x: about(x, width), y: about(y, height) };
}

/** The part of the plane that is shown: the curves where they lie within the limits of y, but not their way to infinity. */
export function planeOf(curves: Curve[], keep: [number, number][], limits?: Range, limitsX = limits): { x: Range; y: Range } {
  const clip = (range: Range | null, to?: Range): Range => clamped(padded(range, 0.08), to);
  // Where both axes mean the same, what leaves the limits of one comes back within those of the other.
  const seen = limitsX === limits ? curves.map((c) => c.x) : curves.map(({ x, y }) => Array.from(x).filter((_, i) => y[i]! >= limits![0] && y[i]! <= limits![1]));
  return {
    x: clip(extent([...seen, keep.map((p) => p[0])]), limitsX),
    y: clip(extent([...curves.map((c) => c.y), keep.map((p) => p[1])]), limits),
  };
}

/** Tick labels with as many digits as the steps between them need: 0.0005 and not 0.001 twice. */
export function tickTexts(splits: readonly (number | null)[], step: number): string[] {
  const size = Math.max(...splits.map((v) => Math.abs(v ?? 0)));
  const power = Math.floor(Math.log10(step) + 1e-9);
  // A step of 2.5 needs one digit more than one of 2.
  const more = Math.abs(step / 10 ** power - Math.round(step / 10 ** power)) > 1e-6 ? 1 : 0;
  const plain = splits.map((v) => (v === null ? "" : v.toFixed(Math.max(0, more - power)).replace(/^-(0(\.0*)?)$/, "$1")));
  if (size === 0 || (power >= -3 && size < 1e6)) return plain;
  const kept = Math.max(0, Math.floor(Math.log10(size)) - power) + more;
  const powers = splits.map((v) => (v === null ? "" : v === 0 ? "0" : v.toExponential(kept).replace("e+", "e")));
  return longest(plain) <= longest(powers) ? plain : powers;
}

const longest = (texts: string[]): number => Math.max(...texts.map((text) => text.length));

/** A logarithmic axis around positive values: from a whole digit of the lowest one's decade to one of the highest one's, and no further. */
export function logRange([low, high]: Range): Range {
  if (low === high) return logRange([low / 10, high * 10]);
  const digits = (value: number, round: (digits: number) => number): number => {
    const decade = 10 ** Math.floor(Math.log10(value) + 1e-9);
    return Number((round(Number((value / decade).toPrecision(9))) * decade).toPrecision(9));
  };
  return [digits(low, Math.floor), digits(high, Math.ceil)];
}

/** Pixels that an axis needs for its labels; most need no more than the least. */
export function axisWidth(texts: readonly string[] | null, least: number): number {
  return Math.max(least, 16 + 7 * longest([...(texts ?? []), ""]));
}

/** A whole digit of a decade on a logarithmic axis: short enough to stand beside its neighbours. */
export function decadeText(value: number): string {
  const power = Math.floor(Math.log10(value) + 1e-9);
  return power > 3 || power < -2 ? `${Math.round(value / 10 ** power)}e${power}` : String(Number(value.toPrecision(6)));
}
