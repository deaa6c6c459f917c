/** Lowest level that is drawn, dB below a unit amplitude: what lies deeper is rounding of the float32 of the curves. */
const FLOOR = -200;

interface Prepared {
  size: number;
  window: Float64Array;
  sum: number;
  cos: Float64Array;
  sin: Float64Array;
}
const prepared = new Map<number, Prepared>();

function prepare(samples: number): Prepared {
  const known = prepared.get(samples);
  if (known) return known;
  const size = 2 ** Math.ceil(Math.log2(Math.max(2, samples)));
  const window = Float64Array.from({ length: samples }, (_, i) => 0.5 - 0.5 * Math.cos((2 * Math.PI * i) / Math.max(1, samples - 1)));
  const made: Prepared = {
    size,
    window,
    sum: window.reduce((a, b) => a + b, 0) || 1,
    cos: Float64Array.from({ length: size / 2 }, (_, i) => Math.cos((2 * Math.PI * i) / size)),
    sin: Float64Array.from({ length: size / 2 }, (_, i) => -Math.sin((2 * Math.PI * i) / size)),
  };
  prepared.set(samples, made);
  return made;
}

/** Frequencies of a spectrum, Hz, without 0. */
export function frequenciesOf(samples: number, step: number): Float64Array {
  const { size } = prepare(samples);
  return Float64Array.from({ length: size / 2 - 1 }, (_, i) => (i + 1) / (size * step));
}

/**
 * Amplitudes of a curve's oscillations, dB of one unit: mean removed, Hann's window, filled up with zeros to a power of two.
 * A sine of amplitude A between two lines is shown at most 1.4 dB too low, as with any Hann window.
 */
export function spectrumOf(values: ArrayLike<number | null>): Float64Array {
  const samples = values.length;
  const { size, window, sum, cos, sin } = prepare(samples);
  let mean = 0;
  let count = 0;
  for (let i = 0; i < samples; i++) {
    const value = values[i];
    if (value === null || !Number.isFinite(value)) continue;
    mean += value!;
    count++;
  }
  mean /= count || 1;
  const re = new Float64Array(size);
  const im = new Float64Array(size);
  for (let i = 0; i < samples; i++) {
    const value = values[i];
    re[i] = value === null || !Number.isFinite(value) ? 0 : (value! - mean) * window[i]!;
  }
  transform(re, im, cos, sin);
  return Float64Array.from({ length: size / 2 - 1 }, (_, i) => (count === 0 ? NaN : Math.max(FLOOR, 20 * Math.log10((2 * Math.hypot(re[i + 1]!, im[i + 1]!)) / sum))));
}

/** The fast Fourier transform in place, radix two. */
function transform(re: Float64Array, im: Float64Array, cos: Float64Array, sin: Float64Array): void {
  const n = re.length;
  for (let i = 1, j = 0; i < n; i++) {
    let bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) {
      [re[i], re[j]] = [re[j]!, re[i]!];
      [im[i], im[j]] = [im[j]!, im[i]!];
    }
  }
  for (let length = 2; length <= n; length *= 2) {
    const half = length / 2;
    const stride = n / length;
    for (let begin = 0; begin < n; begin += length) {
      for (let k = 0; k < half; k++) {
        const c = cos[k * stride]!;
        const s = sin[k * stride]!;
        const a = begin + k;
        const b = a + half;
        const x = re[b]! * c - im[b]! * s;
        const y = re[b]! * s + im[b]! * c;
        re[b] = re[a]! - x;
        im[b] = im[a]! - y;
        re[a] = re[a]! + x;
        im[a] = im[a]! + y;
      }
    }
  }
}
