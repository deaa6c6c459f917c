import { afterEach, expect, it } from "vitest";
import type { ElementEntry } from "@/shared/api/types";
import { groupsOf, keepRecent, recentKinds, symbolOf } from "./groups";
import { telling } from "./telling";

afterEach(() => localStorage.clear());

const entry = (kind: string) => ({ kind, title: kind }) as ElementEntry;

it("blocks stand in groups, and one that the page does not know is not lost", () =>
  expect(groupsOf(["novelty", "sum", "pid", "input", "p"].map(entry)).map(({ group, entries }) => [group, ...entries.map(({ kind }) => kind)])).toEqual([["sources", "input"], ["controllers", "p", "pid"], ["linear", "sum"], ["other", "novelty"]]));

it("every block has a symbol, its own or its group's", () => expect(["sum", "servo_valve", "novelty"].map(symbolOf)).toEqual(["Σ", "⇄", "□"]));

it("the last five kinds are remembered, each once", () => {
  for (const kind of ["p", "pi", "pd", "p", "pid", "gain", "sum"]) keepRecent(kind);
  expect(recentKinds()).toEqual(["sum", "gain", "pid", "p", "pd"]);
  localStorage.setItem("servotune.recent-blocks", "{");
  expect(recentKinds()).toEqual([]);
});

it("what is told of a block does not go by the order of its document", () => {
  const order = ["kp", "ki", "kd"];
  expect(telling({ kind: "pid", kd: 1, kp: 2 }, order)).toBe("kp 2");
  expect(telling({ kp: 2, kd: 1, kind: "pid" }, order)).toBe("kp 2");
  expect(telling({ kind: "subsystem" }, order)).toBeUndefined();
});
