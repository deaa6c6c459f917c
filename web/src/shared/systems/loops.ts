import type { SystemDocument } from "@/shared/api/types";

/** Where a loop may be opened: behind every difference, in subsystems too; else behind every controller that reads a measurement. */
export function loopsOf(document: SystemDocument, prefix = ""): string[] {
  const found: string[] = [];
  for (const [name, block] of Object.entries(document.blocks)) {
    const here = `${prefix}${name}`;
    if (block.kind === "sum" && String(block.signs ?? "").includes("-")) found.push(here);
    else if ((document.connections ?? []).some((wire) => wire.to === `${name}.measurement`)) found.push(here);
    if (block.system) found.push(...loopsOf(block.system, `${here}.`));
  }
  return found;
}
