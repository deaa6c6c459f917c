import { describe, expect, it } from "vitest";
import type { SystemDocument } from "@/shared/api/types";
import { merge } from "./merge";
import { removeBlocks } from "./model";

const base: SystemDocument = {
  parameters: { k: { value: 2, unit: "mm", upper: 5 } },
  blocks: {
    r: { kind: "input" },
    e: { kind: "sum", signs: "+-" },
    c: { kind: "gain", gain: 2 },
    m: { kind: "motor", area: { value: 20, unit: "cm**2" }, mass: 5 },
    inner: { kind: "subsystem", system: { blocks: { u: { kind: "input" }, lag: { kind: "low_pass", frequency: 10 } }, connections: [{ from: "u", to: "lag" }], outputs: { y: "lag" } } },
  },
  connections: [
    { from: "r", to: "e.in1" },
    { from: "m.position", to: "e.in2" },
    { from: "e", to: "c" },
    { from: "c", to: "m.flow" },
  ],
  outputs: { y: "m.position" },
};
const edited = (edit: (copy: SystemDocument) => void): SystemDocument => {
  const copy = structuredClone(base);
  edit(copy);
  return copy;
};

describe("merging three versions", () => {
  it("takes from each side what only it changed, in subsystems too", () => {
    const mine = edited((d) => void (d.blocks.c!.gain = 5));
    const theirs = edited((d) => {
      d.name = "theirs";
      d.blocks.inner!.system!.blocks.lag!.frequency = 20;
      d.blocks.m!.mass = 6;
    });
    const { merged, clashes, dropped } = merge(base, mine, theirs);
    expect([clashes, dropped]).toEqual([[], []]);
    expect(merged).toEqual(edited((d) => {
      d.name = "theirs";
      d.blocks.c!.gain = 5;
      d.blocks.inner!.system!.blocks.lag!.frequency = 20;
      d.blocks.m!.mass = 6;
    }));
  });
  it("asks where both changed one value, and does as it is told", () => {
    const mine = edited((d) => void (d.blocks.c!.gain = 5));
    const theirs = edited((d) => void (d.blocks.c!.gain = 6));
    expect(merge(base, mine, theirs).clashes).toEqual([{ place: "blocks.c.gain", base: 2, mine: 5, theirs: 6 }]);
    expect(merge(base, mine, theirs).merged.blocks.c!.gain).toBe(5);
    expect(merge(base, mine, theirs, { "blocks.c.gain": "theirs" }).merged.blocks.c!.gain).toBe(6);
  });
  it("does not ask where both did the same", () => {
    const both = edited((d) => void (d.blocks.c!.gain = 5));
    expect(merge(base, both, structuredClone(both)).clashes).toEqual([]);
  });
  it("keeps number and unit of a quantity together", () => {
    const mine = edited((d) => void (d.blocks.m!.area = { value: 30, unit: "cm**2" }));
    const theirs = edited((d) => void (d.blocks.m!.area = { value: 0.002, unit: "m**2" }));
    expect(merge(base, mine, theirs).clashes.map((clash) => clash.place)).toEqual(["blocks.m.area"]);
    expect(merge(base, mine, theirs, { "blocks.m.area": "theirs" }).merged.blocks.m!.area).toEqual({ value: 0.002, unit: "m**2" });
  });
  it("joins the bounds of a parameter, but asks when its unit has changed", () => {
    const mine = edited((d) => void (d.parameters!.k!.value = 3));
    expect(merge(base, mine, edited((d) => void (d.parameters!.k!.upper = 9))).merged.parameters!.k).toEqual({ value: 3, unit: "mm", upper: 9 });
    expect(merge(base, mine, edited((d) => void (d.parameters!.k = { value: 2e-3, unit: "m", upper: 5e-3 }))).clashes.map((clash) => clash.place)).toEqual(["parameters.k"]);
  });
  it("gives an input one signal: two different ones are a choice", () => {
    const wired = (from: string) => edited((d) => void (d.connections![2] = { from, to: "c" }));
    expect(merge(base, wired("r"), wired("m.velocity")).clashes).toEqual([{ place: "connections.c", base: "e", mine: "r", theirs: "m.velocity" }]);
    const { merged, clashes } = merge(base, wired("r"), edited((d) => void d.connections!.push({ from: "r", to: "m.force" })));
    expect(clashes).toEqual([]);
    expect(merged.connections).toEqual([{ from: "r", to: "e.in1" }, { from: "m.position", to: "e.in2" }, { from: "r", to: "c" }, { from: "c", to: "m.flow" }, { from: "r", to: "m.force" }]);
  });
  it("asks about a block that one side removed and the other changed", () => {
    const mine = removeBlocks(base, new Set(["c"]));
    const theirs = edited((d) => void (d.blocks.c!.gain = 7));
    const { merged, clashes } = merge(base, mine, theirs);
    expect(clashes.map((clash) => [clash.place, clash.mine])).toEqual([["blocks.c", undefined]]);
    expect(merged.blocks.c).toBeUndefined();
  });
  it("takes a removed block's new connections with it, and says so", () => {
    const mine = removeBlocks(base, new Set(["c"]));
    const theirs = edited((d) => {
      d.connections!.push({ from: "c", to: "m.force" });
      d.outputs.u = "c";
    });
    const { merged, dropped } = merge(base, mine, theirs);
    expect(dropped).toEqual(["c → m.force", "c → u"]);
    expect(merged.connections).toEqual([{ from: "r", to: "e.in1" }, { from: "m.position", to: "e.in2" }]);
    expect(merged.outputs).toEqual({ y: "m.position" });
  });
});
