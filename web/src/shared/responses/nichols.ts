import type { ChartLine, Point } from "@/shared/plots/types";

/** Gains of the closed loop whose contours are drawn, dB; those whose texts matter most come first. */
const LEVELS = [3, 0, -3, 6, -6, -12, -20, 1, -1, 12, -40];
const POINTS = 180;
const TURN = 360;
/** Room for a text at the edge of the chart, as a part of it. */
const EDGE = 0.07;

/**
 * The M-circle of a loop closed by unity feedback: where |L/(1 + L)| = M, that is L = T/(1 - T) with T = M e^(jα).
 *
 * Phase of L in degrees, between -360 and 0, and its magnitude in dB. Above 0 dB it closes about the critical point.
 */
export function mCircle(decibel: number, points = POINTS): { phase: Float64Array; magnitude: Float64Array } {
  const gain = 10 ** (decibel / 20);
  const phase = new Float64Array(points);
  const magnitude = new Float64Array(points);
  for (let i = 0; i < points; i++) {
    // Close together where the loop's gain is largest; never quite at α = 0, where that of 0 dB is infinite.
    const angle = Math.PI * (1 - Math.cos((Math.PI * (i + 0.5)) / points));
    const [re, im] = [gain * Math.cos(angle), gain * Math.sin(angle)];
    const turn = ((Math.atan2(im, re) - Math.atan2(-im, 1 - re)) * TURN) / (2 * Math.PI);
    phase[i] = turn - TURN * Math.ceil(turn / TURN);
    magnitude[i] = 20 * Math.log10(gain / Math.hypot(1 - re, im));
  }
  return { phase, magnitude };
}

const circles = LEVELS.map((level) => ({ level, ...mCircle(level) }));

/** The M-circles that are seen in a range of phases (degrees) and magnitudes (dB), repeated every full turn. */
export function nicholsChart(x: [number, number], y: [number, number]): ChartLine[] {
  const found: ChartLine[] = [];
  for (let turn = Math.ceil(x[0] / TURN); turn <= Math.floor(x[1] / TURN) + 1; turn++) {
    for (const { level, phase, magnitude } of circles) {
      const shifted = phase.map((value) => value + TURN * turn);
      // A closed one ends where it began.
      const close = level > 0;
      const line = { x: close ? [...shifted, shifted[0]!] : shifted, y: close ? [...magnitude, magnitude[0]!] : magnitude };
      const at = placeOf(shifted, magnitude, x, y, close);
      if (at) found.push({ ...line, text: `${level} dB`.replace("-", "−"), at });
    }
  }
  return found;
}

/** Where a text is written: at the top of what closes, else as far right as can be seen. */
function placeOf(phase: Float64Array, magnitude: Float64Array, x: [number, number], y: [number, number], top: boolean): Point | null {
  let best: Point | null = null;
  const [dx, dy] = [EDGE * (x[1] - x[0]), EDGE * (y[1] - y[0])];
  for (let i = 0; i < phase.length; i++) {
    const point: Point = [phase[i]!, magnitude[i]!];
    if (point[0] < x[0] + dx || point[0] > x[1] - dx || point[1] < y[0] + dy || point[1] > y[1] - dy) continue;
    if (best === null || (top ? point[1] > best[1] : point[0] > best[0])) best = point;
  }
  return best;
}
