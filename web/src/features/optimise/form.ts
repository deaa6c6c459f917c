import type { MethodEntry, MetricEntry } from "@/shared/api/types";
import type { components } from "@/shared/api/schema";
import type { Opened } from "@/shared/live/protocol";
import type { Search } from "./schema";

/** What every part of the form works with. */
export interface Part {
  form: Search;
  opened: Opened;
  loops: string[];
  metrics: Map<string, MetricEntry>;
  methods: MethodEntry[];
  signals: components["schemas"]["SignalEntry"][];
  /** Takes over what has been changed; the address follows. */
  change(part: Partial<Search>): void;
  /** What is wrong at a field, `goals.0.upper` say. */
  faultAt(field: string): string | undefined;
}

/** A list with one of its rows changed. */
export function changed<Row>(rows: readonly Row[], at: number, part: Partial<Row>): Row[] {
  return rows.map((row, i) => (i === at ? { ...row, ...part } : row));
}

/** A list without one of its rows. */
export function without<Row>(rows: readonly Row[], at: number): Row[] {
  return rows.filter((_, i) => i !== at);
}
