import type { SystemDocument } from "@/shared/api/types";
import manyLoops from "../../../../examples/systems/many_loops.json";
import intelligentDamper from "../../../../examples/systems/intelligent_damper.json";
import listed from "./templates.json";

export interface Template {
  id: string;
  /** State of the front panel that shows what the study is about. */
  panel: string;
  document: SystemDocument;
}

const KEPT_AS_FILES: Record<string, unknown> = { "many-loops": manyLoops, "intelligent-damper": intelligentDamper };

/** The studies of the examples, ready to be opened. */
export const templates: Template[] = listed.map((entry) => ({ ...entry, document: (KEPT_AS_FILES[entry.id] ?? (entry as { document?: unknown }).document) as SystemDocument }));
