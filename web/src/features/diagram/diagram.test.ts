import { describe, expect, it } from "vitest";
import type { ElementEntry, SystemDocument } from "@/shared/api/types";
import { blockOf, connect, disconnect, feedbackOf, freeName, partOf, pasted, portsOf, removeBlocks, renameBlock, scoped, withScoped } from "./model";

const entry = (kind: string, inputs: string[], outputs: string[]): [string, ElementEntry] => [kind, { kind, inputs, outputs, title: kind, parameters: [], equation: "", source: "", example: { kind } }];
const catalogue = new Map([entry("input", [], ["out"]), entry("sum", ["in1", "in2"], ["out"]), entry("gain", ["in"], ["out"]), entry("motor", ["flow", "force"], ["position", "velocity"]), entry("pid", ["in"], ["out"])]);
const loop: SystemDocument = {
  blocks: { r: { kind: "input" }, e: { kind: "sum", signs: "+-" }, c: { kind: "gain", gain: 2 }, m: { kind: "motor" } },
  connections: [
    { from: "r", to: "e.in1" },
    { from: "m.position", to: "e.in2" },
    { from: "e", to: "c" },
    { from: "c", to: "m.flow" },
  ],
  outputs: { y: "m.position" },
};

describe("ports", () => {
  it("follow from values where they do", () => {
    expect(portsOf({ kind: "sum", signs: "+-+" }, catalogue).inputs).toEqual(["in1", "in2", "in3"]);
    expect(portsOf({ kind: "pid", setpoint_weight_p: 1 }, catalogue).inputs).toEqual(["reference", "measurement"]);
    expect(portsOf({ kind: "state_space", D: [[0, 0], [0, 0], [0, 0]] }, catalogue)).toEqual({ inputs: ["in1", "in2"], outputs: ["out1", "out2", "out3"] });
    expect(portsOf({ kind: "subsystem", system: loop }, catalogue)).toEqual({ inputs: ["r"], outputs: ["y"] });
  });
});

describe("edits", () => {
  it("put one signal into an input, by the shortest name", () => {
    const changed = connect(loop, catalogue, { block: "r", port: "out" }, { block: "m", port: "flow" });
    expect(changed.connections).toContainEqual({ from: "r", to: "m.flow" });
    expect(changed.connections).not.toContainEqual({ from: "c", to: "m.flow" });
    expect(connect(loop, catalogue, { block: "m", port: "velocity" }, { block: "c", port: "in" }).connections).toContainEqual({ from: "m.velocity", to: "c" });
  });
  it("take a signal away", () => expect(disconnect(loop, catalogue, { block: "c", port: "in" }).connections).not.toContainEqual({ from: "e", to: "c" }));
  it("remove a block with its connections and outputs", () => expect(removeBlocks(loop, new Set(["m"]))).toMatchObject({ outputs: {}, connections: [{ from: "r", to: "e.in1" }, { from: "e", to: "c" }] }));
  it("rename a block wherever it is named", () => expect(renameBlock(loop, "m", "motor")).toMatchObject({ outputs: { y: "motor.position" }, connections: expect.arrayContaining([{ from: "motor.position", to: "e.in2" }]) as unknown }));
  it("paste with the connections inside, under free names", () => {
    const { document, names } = pasted(loop, partOf(loop, new Set(["e", "c"])));
    expect(names).toEqual(["e_2", "c_2"]);
    expect(document.connections).toContainEqual({ from: "e_2", to: "c_2" });
  });
  it("reach into systems inside of systems", () => {
    const outer: SystemDocument = { blocks: { inner: { kind: "subsystem", system: loop } }, outputs: { y: "inner" } };
    const changed = withScoped(outer, ["inner"], (inner) => removeBlocks(inner, new Set(["c"])));
    expect(Object.keys(scoped(changed, ["inner"])!.blocks)).toEqual(["r", "e", "m"]);
    expect(scoped(outer, ["nothing"])).toBeUndefined();
  });
  it("find free names and make fresh blocks", () => {
    expect(freeName("motor", ["motor", "motor_2"])).toBe("motor_3");
    expect(blockOf(catalogue.get("gain")!)).toEqual({ kind: "gain" });
  });
});

it("feedback is what leads back", () => expect([...feedbackOf(loop)]).toEqual(["e.in2"]));
