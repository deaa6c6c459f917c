import type { Scalar } from "@/shared/api/types";
import { readEntry } from "@/shared/units/number";

/** One scenario a line, values separated by semicolons; undefined where a line cannot be read. */
export function readScenarios(text: string): Record<string, Scalar>[] | undefined {
  const found: Record<string, Scalar>[] = [];
  for (const line of text.split("\n").filter((l) => l.trim() !== "")) {
    const scenario: Record<string, Scalar> = {};
    for (const part of line.split(";").filter((p) => p.trim() !== "")) {
      const [name = "", ...rest] = part.split("=");
      const entry = readEntry(rest.join("="));
      if (name.trim() === "" || (entry.kind !== "number" && entry.kind !== "quantity")) return undefined;
      scenario[name.trim()] = entry.kind === "number" ? entry.value : { value: entry.value, unit: entry.unit };
    }
    found.push(scenario);
  }
  return found;
}
