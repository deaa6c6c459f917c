/** Numbers with their units, as a page shows them. */

const SUPERSCRIPTS = "⁰¹²³⁴⁵⁶⁷⁸⁹";
/** Units that take a prefix when they stand alone. */
const PREFIXED = new Set(["s", "m", "V", "A", "N", "Pa", "ohm", "F", "H", "W", "J", "N*m", "m/s", "rad/s", "m/s**2"]);
const STEPS: [number, string][] = [[1e9, "G"], [1e6, "M"], [1e3, "k"], [1, ""], [1e-3, "m"], [1e-6, "µ"], [1e-9, "n"]];

export function prettyUnit(unit: string): string {
  if (unit === "1" || unit === "") return "";
  return unit
    .replace(/\*\*(-?)(\d+)/g, (_, sign: string, digits: string) => (sign ? "⁻" : "") + [...digits].map((d) => SUPERSCRIPTS[Number(d)]).join(""))
    .replaceAll("*", "·")
    .replaceAll("ohm", "Ω");
}

/** Four significant digits, no trailing zeros, exponents only where they must be. */
export function formatNumber(value: number, digits = 4): string {
  if (value === 0) return "0";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : value < 0 ? "−∞" : "–";
  const size = Math.abs(value);
  const text = size >= 1e6 || size < 1e-4 ? value.toExponential(digits - 1) : value.toPrecision(digits);
  const [mantissa, exponent] = text.split("e");
  const short = mantissa!.includes(".") ? mantissa!.replace(/\.?0+$/, "") : mantissa!;
  return (exponent === undefined ? short : `${short}e${exponent.replace("+", "")}`).replace("-", "−").replace("e-", "e−");
}

export interface Shown {
  text: string;
  unit: string;
}

/** A value in SI with the prefix that makes it readable: 0.0021 s is 2.1 ms. */
export function formatQuantity(value: number, unit: string, digits = 4): Shown {
  if (PREFIXED.has(unit) && value !== 0 && Number.isFinite(value)) {
    const size = Math.abs(value);
    const [factor, prefix] = STEPS.find(([step]) => size >= step * 0.9999995) ?? STEPS[STEPS.length - 1]!;
    if (!(unit === "m" && prefix === "k") && !(unit === "s" && factor > 1)) return { text: formatNumber(value / factor, digits), unit: prefix + prettyUnit(unit) };
  }
  return { text: formatNumber(value, digits), unit: prettyUnit(unit) };
}

export function withUnit(value: number, unit: string, digits = 4): string {
  const shown = formatQuantity(value, unit, digits);
  return shown.unit ? `${shown.text} ${shown.unit}` : shown.text;
}

const PERCENT = new Set(["overshoot", "undershoot"]);
/** Per cent, degrees and decibel are numbers of sizes about 1: what lies below this is rounding. */
const ROUNDING = 1e-9;
const rounded = (value: number, unit: string): Shown => ({ text: formatNumber(Math.abs(value) < ROUNDING ? 0 : value), unit });

/** A metric in the unit in which its field speaks of it: per cent, degrees, decibel. */
export function formatMetric(kind: string, value: number, unit: string): Shown {
  if (PERCENT.has(kind)) return rounded(value * 100, "%");
  if (kind === "phase_margin") return rounded((value * 180) / Math.PI, "°");
  if (kind.startsWith("gain_margin") && unit === "1" && value > 0) return rounded(20 * Math.log10(value), "dB");
  return formatQuantity(value, unit);
}

/** What an axis is called: the name and, where there is one, the unit. */
export function named(name: string, unit: string): string {
  const pretty = prettyUnit(unit);
  return pretty ? `${name} [${pretty}]` : name;
}

/** `rise_time` as "rise time". */
export function words(name: string): string {
  return name.replaceAll("_", " ");
}
