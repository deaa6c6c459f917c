import type { Block } from "@/shared/api/types";
import { shownScalar } from "@/shared/ui/NumberEntry";
import { prettyUnit, words } from "@/shared/units/format";

/** What a reader wants to see of a block without opening it: its first value, in the order of its parameters and not of its document; a fraction's polynomials. */
export function telling(block: Block, order: readonly string[]): string | undefined {
  if (Array.isArray(block.numerator) && Array.isArray(block.denominator)) return `${polynomial(block.numerator)} / ${polynomial(block.denominator)}`;
  const entries = [...order, ...Object.keys(block).filter((key) => !order.includes(key)).sort()].map((key) => [key, block[key]] as const);
  const first = entries.find(([key, value]) => key !== "kind" && key !== "role" && (typeof value === "number" || typeof value === "string" || (typeof value === "object" && value !== null && "unit" in value)));
  if (!first) return undefined;
  const [key, value] = first;
  const quantity = typeof value === "object" ? (value as { value: unknown; unit: string }) : undefined;
  return `${words(key)} ${quantity ? `${String(quantity.value)} ${prettyUnit(quantity.unit)}` : shownScalar(value)}`;
}

function polynomial(coefficients: unknown[]): string {
  const terms = coefficients.flatMap((coefficient, i) => {
    const power = coefficients.length - 1 - i;
    if (coefficient === 0) return [];
    const symbol = power === 0 ? "" : power === 1 ? "s" : `s${[...String(power)].map((digit) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[Number(digit)]).join("")}`;
    const value = typeof coefficient === "number" ? String(coefficient) : `(${shownScalar(coefficient).replace(/^=/, "")})`;
    return [symbol && value === "1" ? symbol : value + symbol];
  });
  return terms.length === 0 ? "0" : terms.join(" + ");
}
