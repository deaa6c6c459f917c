import type { LiveParameter } from "@/shared/live/protocol";

/** The range of a slider: the author's bounds, or a decade around the value. */
export interface Travel {
  low: number;
  high: number;
  log: boolean;
}

export type Scale = "log" | "linear";

export function travelOf(parameter: LiveParameter, wanted?: Scale): Travel {
  const { value } = parameter;
  let low = parameter.lower;
  let high = parameter.upper;
  if (value === 0) return { low: Math.max(low ?? -1, -1), high: Math.min(high ?? 1, 1), log: false };
  const size = Math.abs(value);
  // A physical bound of 0 or of thousands of times the value is no range to search in.
  const wide = low === null || high === null || high > 100 * size || low < -100 * size || (value > 0 && low <= 0);
  if (wide) {
    const near: [number, number] = value > 0 ? [value / 5, value * 5] : [value * 5, value / 5];
    low = Math.max(low ?? -Infinity, near[0]);
    high = Math.min(high ?? Infinity, near[1]);
  }
  const travel = { low: low!, high: high!, log: false };
  travel.log = travel.low > 0 && (wanted === undefined ? parameter.scale === "log" || travel.high / travel.low > 8 : wanted === "log");
  return travel;
}

/** 0..1 along the slider. */
export function toPosition(value: number, { low, high, log }: Travel): number {
  if (!(high > low)) return 0;
  const part = log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low);
  return Number.isFinite(part) ? Math.min(1, Math.max(0, part)) : 0;
}

export function fromPosition(position: number, { low, high, log }: Travel): number {
  const at = Math.min(1, Math.max(0, position));
  const value = log ? low * (high / low) ** at : low + (high - low) * at;
  // Ends are exact; between them four digits are what a hand can aim at.
  return at === 0 ? low : at === 1 ? high : Number(value.toPrecision(4));
}

const KEYS: Record<string, number> = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageUp: 10, PageDown: -10 };

/** Where a key moves a slider: a hundredth, ten with Shift, a tenth with Alt; null for keys that mean nothing here. */
export function keyPosition(key: string, position: number, modifiers: { shift: boolean; alt: boolean }): number | null {
  if (key === "Home") return 0;
  if (key === "End") return 1;
  const steps = KEYS[key];
  if (steps === undefined) return null;
  return Math.min(1, Math.max(0, position + steps * 0.01 * (modifiers.shift ? 10 : 1) * (modifiers.alt ? 0.1 : 1)));
}
