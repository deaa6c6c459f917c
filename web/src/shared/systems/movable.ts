import type { LiveParameter } from "@/shared/live/protocol";

/** What to vary where nobody has said: the author's parameters first, then those of the blocks. */
export function firstSliders(parameters: LiveParameter[], most = 6): string[] {
  const movable = parameters.filter((p) => !p.bound && p.value !== 0);
  const own = movable.filter((p) => !p.path.includes("."));
  const rest = movable.filter((p) => p.path.includes(".") && !/\.(role|initial)$/.test(p.path));
  return [...own, ...rest].slice(0, most).map((p) => p.path);
}
