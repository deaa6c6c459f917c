import { useMemo } from "react";
import type { SystemDocument } from "@/shared/api/types";
import type { Check } from "./useCheck";

/** Where the system at a scope stands in what the service was asked. */
export const pointerOf = (scope: readonly string[]): string => `/system${scope.map((name) => `/blocks/${name}/system`).join("")}`;

/** What the service says of each block of the system at `pointer`: what is wrong, and what is only odd. */
export function useFaults(check: Check, pointer: string, document: SystemDocument) {
  const problems = useMemo(() => byBlock(check.problem?.document.errors ?? [], pointer, document), [check.problem, pointer, document]);
  const warnings = useMemo(() => byBlock(check.warnings, pointer, document), [check.warnings, pointer, document]);
  return { problems, warnings };
}

/** The first word on each block. */
function byBlock(told: readonly { pointer: string; detail: string }[], pointer: string, document: SystemDocument): ReadonlyMap<string, string> {
  const found = new Map<string, string>();
  for (const one of told) {
    const name = blockAt(one.pointer, pointer, document);
    if (name !== undefined && !found.has(name)) found.set(name, one.detail);
  }
  return found;
}

/** The block, in the system at `pointer`, that a fault belongs to; one of a connection belongs to the block it leads to. */
function blockAt(place: string, pointer: string, document: SystemDocument): string | undefined {
  if (!place.startsWith(`${pointer}/`)) return undefined;
  const rest = place.slice(pointer.length);
  const wire = /^\/connections\/(\d+)/.exec(rest);
  if (wire) return document.connections?.[Number(wire[1])]?.to.split(".")[0];
  return /^\/blocks\/([^/]+)/.exec(rest)?.[1];
}
