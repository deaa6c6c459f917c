import type { Point } from "@/shared/plots/types";
import type { Locus } from "./locus";
import type { Margins } from "./margins";

/** Frequency responses over the values of one parameter: what a curve does when it is pulled. */
export interface Family {
  path: string;
  /** Rising. */
  values: number[];
  /** Rising, rad/s. */
  frequency: number[];
  /** For each value, at each frequency. */
  responses: { re: ArrayLike<number>; im: ArrayLike<number> }[];
}

export type Plane = "bode" | "nyquist" | "nichols";
export const PLANES: readonly string[] = ["bode", "nyquist", "nichols"] satisfies Plane[];

interface Curve {
  frequency: ArrayLike<number>;
  magnitude: ArrayLike<number>;
  phase: ArrayLike<number>;
}

const DEGREES = 180 / Math.PI;
const TURN = 360;

/** The interval of a rising list in which a value lies, and the part of it that is passed, over its logarithm. */
function between(list: ArrayLike<number>, value: number): { k: number; part: number } {
  const last = list.length - 1;
  let [low, high] = [0, last];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (list[middle]! <= value) low = middle;
    else high = middle;
  }
  const part = Math.log(value / list[low]!) / Math.log(list[high]! / list[low]!);
  return { k: low, part: Number.isFinite(part) ? Math.min(1, Math.max(0, part)) : 0 };
}

/** Where a curve is taken hold of: at the crossover that tells the phase margin, else where its gain is nearest to 1. */
export function gripAt({ frequency, magnitude }: Curve, margins: Margins | null): number | null {
  if (margins?.phase) return margins.phase.frequency;
  let best: number | null = null;
  for (let i = 0; i < frequency.length; i++) if (Number.isFinite(magnitude[i]!) && frequency[i]! > 0 && (best === null || Math.abs(magnitude[i]!) < Math.abs(magnitude[best]!))) best = i;
  return best === null ? null : frequency[best]!;
}

/** The point of a curve at a frequency, in the units of a plane: rad/s and dB; real and imaginary part; degrees and dB. */
export function pointAt({ frequency, magnitude, phase }: Curve, at: number, plane: Plane): Point | null {
  const { k, part } = between(frequency, at);
  const mean = (list: ArrayLike<number>) => (part === 0 ? list[k]! : list[k]! + part * (list[k + 1]! - list[k]!));
  const point = inPlane(plane, at, mean(magnitude), mean(phase));
  return point.every(Number.isFinite) ? point : null;
}

function inPlane(plane: Plane, frequency: number, decibel: number, degrees: number): Point {
  if (plane === "bode") return [frequency, decibel];
  if (plane === "nichols") return [degrees, decibel];
  const size = 10 ** (decibel / 20);
  return [size * Math.cos(degrees / DEGREES), size * Math.sin(degrees / DEGREES)];
}

/**
 * The way of the point at one frequency over the values of the parameter, in the units of a plane.
 *
 * Phases are those nearest to `phase` (degrees), and go on without jumps: the curve that is drawn has turns that a single point does not tell.
 */
export function wayOf({ path, values, frequency, responses }: Family, at: number, plane: Plane, phase: number): Locus {
  const { k, part } = between(frequency, at);
  const [re, im] = [new Float64Array(values.length), new Float64Array(values.length)];
  let before = phase;
  responses.forEach((response, i) => {
    const [decibel, angle] = betweenTwo(response, k, part);
    const degrees = angle + TURN * Math.round((before - angle) / TURN);
    if (Number.isFinite(degrees)) before = degrees;
    [re[i], im[i]] = inPlane(plane, at, decibel, degrees) as [number, number];
    // Both axes of a Bode plot are logarithms; the way goes straight up.
    if (plane === "bode") re[i] = 0;
  });
  return { path, values, branches: [{ re, im }] };
}

/** Magnitude (dB) and phase (degrees) between two neighbours: straight over the logarithm of the frequency. */
function betweenTwo({ re, im }: Family["responses"][number], k: number, part: number): [number, number] {
  const decibel = (i: number) => 20 * Math.log10(Math.hypot(re[i]!, im[i]!));
  const angle = (i: number) => Math.atan2(im[i]!, re[i]!) * DEGREES;
  if (part === 0) return [decibel(k), angle(k)];
  const turned = angle(k + 1) - angle(k);
  return [decibel(k) + part * (decibel(k + 1) - decibel(k)), angle(k) + part * (turned - TURN * Math.round(turned / TURN))];
}
