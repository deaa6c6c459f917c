import type { Scalar } from "@/shared/api/types";
import { readEntry } from "@/shared/units/number";

/** What a whole curve is held against, as the contract says it: corners, or the magnitude of a rational function. */
export type Curve = [Scalar, Scalar][] | { numerator: number[]; denominator: number[] };

/** Of curves over time the SI unit of a corner's place; of those over frequency. */
export const PLACE = { time: "s", frequency: "rad/s" } as const;

/**
 * Reads corners as people write them, `0: 1.2; 500 ms: 1.05`, and over frequency also a rational function with its highest power
 * of s first, `1 0.2 / 1 3 2`; undefined where the text is neither.
 */
export function readCurve(text: string, over: keyof typeof PLACE, unit = ""): Curve | undefined {
  if (over === "frequency" && text.includes("/") && !text.includes(":")) {
    const sides = text.split("/").map((side) => side.trim().split(/[\s;]+/).map(Number));
    const [numerator, denominator] = sides;
    return sides.length === 2 && sides.every((side) => side.length > 0 && side.every(Number.isFinite)) ? { numerator: numerator!, denominator: denominator! } : undefined;
  }
  const corners = text.split(";").filter((part) => part.trim() !== "").map((part): [Scalar, Scalar] | null => {
    const [place, value, ...more] = part.split(":");
    const both = [scalarOf(place ?? "", PLACE[over]), scalarOf(value ?? "", unit)];
    return more.length > 0 || both[0] === undefined || both[1] === undefined ? null : [both[0], both[1]];
  });
  return corners.length < 2 || corners.includes(null) ? undefined : (corners as [Scalar, Scalar][]);
}

function scalarOf(text: string, unit: string): Scalar | undefined {
  const entry = readEntry(text, unit);
  return entry.kind === "number" ? entry.value : entry.kind === "quantity" ? { value: entry.value, unit: entry.unit } : undefined;
}
