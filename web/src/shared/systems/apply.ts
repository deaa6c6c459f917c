import type { Block, SystemDocument } from "@/shared/api/types";

/** A value in SI, and its SI unit ("" or "1" where it has none). */
export interface Applied {
  value: number;
  unit: string;
}

/** The document with other values of some of its parameters, addressed as everywhere: `kp`, `motor.area`, `inner.motor.area`. */
export function withValues(document: SystemDocument, values: Record<string, Applied>): SystemDocument {
  return Object.entries(values).reduce((changed, [path, value]) => withValue(changed, path.split("."), value), document);
}

function withValue(document: SystemDocument, [name, ...rest]: string[], applied: Applied): SystemDocument {
  if (name === undefined) return document;
  const own = document.parameters?.[name];
  if (rest.length === 0 && own) {
    // The author's unit stays; the value says its own, or it would be taken for one in the author's.
    const value = own.unit === undefined && typeof own.value !== "object" ? applied.value : { value: applied.value, unit: applied.unit || "1" };
    return { ...document, parameters: { ...document.parameters, [name]: { ...own, value } } };
  }
  const block = document.blocks[name];
  if (!block || rest.length === 0) return document;
  const next: Block = block.system ? { ...block, system: withValue(block.system, rest, applied) } : { ...block, [rest[0]!]: applied.value };
  return { ...document, blocks: { ...document.blocks, [name]: next } };
}
