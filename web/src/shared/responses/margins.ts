/** Margins as they are read off the curves of an opened loop. */
export interface Margins {
  /** Where the gain is 1: its frequency, the phase there, and the odd half turn that it is compared with, degrees. */
  phase: { frequency: number; at: number; turn: number } | null;
  /** Where the phase is an odd half turn: its frequency and the gain there, dB. */
  gain: { frequency: number; magnitude: number; turn: number } | null;
}

const HALF = 180;

/** The odd half turn nearest to a phase: -180, 180, -540 ... */
function halfTurn(phase: number): number {
  return HALF + 2 * HALF * Math.round((phase - HALF) / (2 * HALF));
}

/** The smallest margins, from magnitude (dB) and phase (degrees, without jumps), straight between the points. */
export function marginsOf(frequency: Float32Array, magnitude: Float32Array, phase: Float32Array): Margins {
  let byPhase: Margins["phase"] = null;
  let byGain: Margins["gain"] = null;
  const between = (i: number, part: number) => Math.exp(Math.log(frequency[i - 1]!) + part * Math.log(frequency[i]! / frequency[i - 1]!));
  for (let i = 1; i < frequency.length; i++) {
    const [m0, m1, p0, p1] = [magnitude[i - 1]!, magnitude[i]!, phase[i - 1]!, phase[i]!];
    if (m0 > 0 !== m1 > 0) {
      const part = m0 / (m0 - m1);
      const at = p0 + part * (p1 - p0);
      const turn = halfTurn(at);
      if (byPhase === null || Math.abs(at - turn) < Math.abs(byPhase.at - byPhase.turn)) byPhase = { frequency: between(i, part), at, turn };
    }
    const turn = halfTurn((p0 + p1) / 2);
    if (p0 > turn !== p1 > turn) {
      const part = (turn - p0) / (p1 - p0);
      const here = m0 + part * (m1 - m0);
      if (Number.isFinite(here) && (byGain === null || Math.abs(here) < Math.abs(byGain.magnitude))) byGain = { frequency: between(i, part), magnitude: here, turn };
    }
  }
  return { phase: byPhase, gain: byGain };
}
