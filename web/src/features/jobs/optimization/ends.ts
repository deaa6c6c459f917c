/** A share of the range within which a value is at its end. */
const NEAR = 1e-3;

/** At which end of its range a value lies, if at one: there the range decides, not the goals. */
export function endOf(value: number, { lower, upper }: { lower?: number | undefined; upper?: number | undefined }): "lower" | "upper" | null {
  const width = lower !== undefined && upper !== undefined ? upper - lower : Math.abs(value);
  // Of a range over decades a share of its width would hold the smallest of them.
  const near = (end: number) => Math.abs(value - end) <= NEAR * (end === 0 || lower === 0 ? width : Math.min(width, Math.abs(end)));
  if (lower !== undefined && (value <= lower || near(lower))) return "lower";
  return upper !== undefined && (value >= upper || near(upper)) ? "upper" : null;
}
