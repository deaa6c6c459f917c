import type { SystemDocument } from "@/shared/api/types";
import type { Kept } from "./store";

/** What stays in this browser: where blocks stand, and what has been edited and is not saved yet. */
export interface Draft {
  document: SystemDocument;
  /** What it was made from, as the service had it. */
  base: SystemDocument;
  etag: string;
  at: string;
}

const PICTURE = (id: string) => `servotune-places-${id}`;
const DRAFT = (id: string) => `servotune-draft-${id}`;

function read<T>(key: string): Partial<T> | null {
  try {
    const found: unknown = JSON.parse(localStorage.getItem(key) ?? "null");
    return typeof found === "object" ? (found as Partial<T> | null) : null;
  } catch {
    return null;
  }
}

/** A full store keeps nothing new; what is edited is on the page all the same. */
function write(key: string, value: unknown): void {
  try {
    localStorage.setItem(key, JSON.stringify(value));
  } catch (error) {
    if (!(error instanceof DOMException)) throw error;
  }
}

export function keptPicture(id: string): Kept {
  const found = read<Kept>(PICTURE(id));
  return { places: found?.places ?? {}, routes: found?.routes ?? {} };
}

export function keepPicture(id: string, kept: Kept): void {
  write(PICTURE(id), kept);
}

export function keptDraft(id: string): Draft | null {
  const found = read<Draft>(DRAFT(id));
  return found?.document?.blocks && found.base?.blocks && found.etag && found.at ? (found as Draft) : null;
}

export function keepDraft(id: string, draft: Draft): void {
  write(DRAFT(id), draft);
}

export function dropDraft(id: string): void {
  localStorage.removeItem(DRAFT(id));
}
