import type { Metric } from "@/shared/api/types";
import type { ProblemDocument } from "@/shared/api/problem";

/** What the page says to `/v1/live` and hears from it; curves come as one binary frame. */

export interface LiveParameter {
  path: string;
  value: number;
  unit: string;
  lower: number | null;
  upper: number | null;
  scale: "linear" | "log";
  doc: string;
  /** An expression gives the value: it cannot be moved itself. */
  bound: boolean;
}

/** A recorded channel at the instants of the picture, SI; null outside of the recording. */
export interface Measured {
  output: string;
  dataset: string;
  channel: string;
  /** Standard deviation of the noise of a sample. */
  sigma: number;
  values: (number | null)[];
  low: (number | null)[];
  high: (number | null)[];
}

export interface Opened {
  type: "opened";
  system: { id: string; revision: number } | null;
  inputs: string[];
  outputs: { name: string; unit: string }[];
  parameters: LiveParameter[];
  curves: string[];
  metrics: string[];
  duration: number;
  nonlinear: boolean;
  measured: Measured[];
  warnings: { pointer: string; detail: string }[];
}

export interface MetricsMessage {
  type: "metrics";
  seq: number;
  variant: number;
  metrics: Record<string, Metric>;
  elasticities: Record<string, Record<string, number | null>>;
}

export interface ProblemMessage {
  type: "problem";
  seq: number | null;
  problem: ProblemDocument;
}

export type LiveMessage = Opened | MetricsMessage | ProblemMessage;

export interface Frame {
  seq: number;
  variants: { verdict: string; advice?: string }[];
  time: Float32Array;
  frequency: Float32Array;
  /** Curves of one output: `outputs(variant, output)`. */
  outputs(variant: number, output: number): Float32Array;
  response(variant: number): { re: Float32Array; im: Float32Array };
  poles(variant: number): { re: Float32Array; im: Float32Array };
}

interface Header {
  seq: number;
  variants: Frame["variants"];
  arrays: { name: string; shape: number[] }[];
}

/** Reads a frame where it lies, without copying a number. */
export function readFrame(buffer: ArrayBuffer): Frame {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length))) as Header;
  const found = new Map<string, { shape: number[]; data: Float32Array }>();
  let place = 4 + length;
  for (const { name, shape } of header.arrays) {
    const size = shape.reduce((a, b) => a * b, 1);
    if (place + 4 * size > buffer.byteLength) throw new Error(`frame must be at least ${place + 4 * size} bytes, got ${buffer.byteLength}`);
    found.set(name, { shape, data: new Float32Array(buffer, place, size) });
    place += 4 * size;
  }
  if (place !== buffer.byteLength) throw new Error(`frame must be ${place} bytes, got ${buffer.byteLength}`);
  const part = (name: string, ...index: number[]): Float32Array => {
    const { shape, data } = found.get(name)!;
    let start = 0;
    let size = data.length;
    index.forEach((i, k) => {
      size /= shape[k]! || 1;
      start += i * size;
    });
    return data.subarray(start, start + size);
  };
  return {
    seq: header.seq,
    variants: header.variants,
    time: part("time"),
    frequency: part("frequency"),
    outputs: (variant, output) => part("outputs", variant, output),
    response: (variant) => ({ re: part("response", variant, 0), im: part("response", variant, 1) }),
    poles: (variant) => ({ re: part("poles", variant, 0), im: part("poles", variant, 1) }),
  };
}

/** Magnitude in dB and phase in degrees, the phase without jumps. */
export function bode(re: Float32Array, im: Float32Array): { magnitude: Float32Array; phase: Float32Array } {
  const magnitude = new Float32Array(re.length);
  const phase = new Float32Array(re.length);
  let turns = 0;
  let before: number | null = null;
  for (let i = 0; i < re.length; i++) {
    const size = Math.hypot(re[i]!, im[i]!);
    magnitude[i] = 20 * Math.log10(size);
    // What does not come through is not late either.
    if (size === 0) {
      phase[i] = NaN;
      continue;
    }
    const angle = (Math.atan2(im[i]!, re[i]!) * 180) / Math.PI;
    if (before !== null) turns -= 360 * Math.round((angle - before) / 360);
    // At the first frequency a loop is looked at from below: -180 and not +180 degrees for a double integrator.
    else if (angle > 90) turns = -360;
    before = angle;
    phase[i] = angle + turns;
  }
  return { magnitude, phase };
}
