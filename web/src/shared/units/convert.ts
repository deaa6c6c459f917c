/** Units that people type where another one is kept: what one of each is in that unit. The service knows all others. */

const TURN = 2 * Math.PI;
const COMMON: Record<string, [unit: string, factor: number]> = {
  Hz: ["rad/s", TURN],
  kHz: ["rad/s", 1e3 * TURN],
  rpm: ["rad/s", TURN / 60],
  "1/min": ["rad/s", TURN / 60],
  deg: ["rad", Math.PI / 180],
  "°": ["rad", Math.PI / 180],
  "deg/s": ["rad/s", Math.PI / 180],
  min: ["s", 60],
  h: ["s", 3600],
  cm: ["m", 1e-2],
  "cm/s": ["m/s", 1e-2],
  bar: ["Pa", 1e5],
  mbar: ["Pa", 1e2],
  g: ["kg", 1e-3],
  t: ["kg", 1e3],
  "%": ["1", 1e-2],
};

/** Returns the number in `unit` (SI) of so many of another unit; null where that is not known here. */
export function inUnit(value: number, written: string, unit: string): number | null {
  const known = COMMON[written.replaceAll(" ", "")];
  const wanted = unit === "" ? "1" : unit;
  return known && known[0] === wanted ? Number((value * known[1]).toPrecision(15)) : null;
}
