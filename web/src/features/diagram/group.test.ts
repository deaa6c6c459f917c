import { describe, expect, it } from "vitest";
import type { ElementEntry, SystemDocument } from "@/shared/api/types";
import manyLoops from "../../../../examples/systems/many_loops.json";
import { dissolved, grouped } from "./group";
import { openedOf } from "./opened";

const entry = (kind: string, inputs: string[], outputs: string[]): [string, ElementEntry] => [kind, { kind, inputs, outputs, title: kind, parameters: [], equation: "", source: "", example: { kind } }];
const catalogue = new Map([entry("input", [], ["out"]), entry("sum", ["in1", "in2"], ["out"]), entry("gain", ["in"], ["out"]), entry("motor", ["flow", "force"], ["position", "velocity"])]);
const loop: SystemDocument = {
  parameters: { k: { value: 2 }, both: { value: "=k/2" } },
  blocks: { r: { kind: "input" }, load: { kind: "input" }, e: { kind: "sum", signs: "+-" }, c: { kind: "gain", gain: "=both" }, m: { kind: "motor" }, g: { kind: "gain", gain: "=both" } },
  connections: [
    { from: "r", to: "e.in1" },
    { from: "m.position", to: "e.in2" },
    { from: "e", to: "c" },
    { from: "c", to: "m.flow" },
    { from: "load", to: "m.force" },
    { from: "m.velocity", to: "g" },
  ],
  outputs: { y: "m.position", v: "g" },
};

describe("a subsystem made from a selection", () => {
  it("has the crossing signals as its ports", () => {
    const { document, name } = grouped(loop, new Set(["c", "m"]), new Set(), catalogue, "drive");
    expect(name).toBe("drive");
    expect(document.connections).toEqual([
      { from: "r", to: "e.in1" },
      { from: "drive.position", to: "e.in2" },
      { from: "e", to: "drive.e" },
      { from: "load", to: "drive.load" },
      { from: "drive.velocity", to: "g" },
    ]);
    expect(document.outputs).toEqual({ y: "drive.position", v: "g" });
    const inner = document.blocks.drive!.system!;
    expect(Object.keys(inner.blocks).sort()).toEqual(["c", "e", "load", "m"]);
    expect(inner.outputs).toEqual({ position: "m.position", velocity: "m.velocity" });
  });
  it("gets the parameters that its expressions name, and those that these name", () => {
    const { document, doubled } = grouped(loop, new Set(["c", "m"]), new Set(), catalogue, "drive");
    expect(document.blocks.drive!.system!.parameters).toEqual(loop.parameters);
    expect(document.parameters).toEqual(loop.parameters);
    expect(doubled).toEqual(["both", "k"]);
    const alone = grouped(loop, new Set(["c", "m", "g"]), new Set(), catalogue, "drive");
    expect(alone.document.parameters).toBeUndefined();
    expect(alone.doubled).toEqual([]);
  });
  it("takes inputs and outputs that are chosen too as its ports", () => {
    const { document } = grouped(loop, new Set(Object.keys(loop.blocks)), new Set(["y"]), catalogue, "axis");
    expect(Object.keys(document.blocks)).toEqual(["axis"]);
    expect(document.blocks.axis!.system!.outputs).toEqual({ y: "m.position", v: "g" });
    expect(document.outputs).toEqual({ v: "axis.v" });
    expect(document.connections).toEqual([]);
  });
  it("is the same diagram again when it is dissolved", () => {
    const { document, name } = grouped(loop, new Set(["c", "m"]), new Set(), catalogue, "drive");
    const back = dissolved(document, name, catalogue)!.document;
    const wires = (d: SystemDocument) => (d.connections ?? []).map((wire) => `${wire.from} ${wire.to}`).sort();
    expect(wires(back)).toEqual(wires(loop));
    expect(back.outputs).toEqual(loop.outputs);
    expect(back.blocks).toEqual(loop.blocks);
  });
});

it("six nested loops opened are one diagram: every signal goes from block to block", () => {
  const document = manyLoops as unknown as SystemDocument;
  const kinds = new Map(
    [entry("low_pass", ["in"], ["out"]), entry("linear_hydraulic_motor", ["flow", "force"], ["position", "velocity", "acceleration", "pressure_difference"]), ...["p", "pi", "pid", "feed_forward", "lead_lag", "notch", "rc_network", "transfer_function", "first_order_sensor", "accelerometer", "velocity_transducer"].map((kind) => entry(kind, ["in"], ["out"]))].concat([...catalogue]),
  );
  const opened = openedOf(document, kinds);
  expect([...opened.frames.keys()].map((path) => path.split(".").length)).toEqual([1, 2, 3, 4, 5]);
  const axis = "velocity_loop.acceleration_loop.pressure_loop";
  const from = (id: string) => opened.wires.find((wire) => wire.id === id)?.from;
  // Position comes out through four borders, the reference of the current loop goes in through one.
  expect(from("error.in2")).toEqual({ block: `${axis}.motor`, port: "position" });
  expect(from(`${axis}.spool_loop.current_loop.error.in1`)).toEqual({ block: `${axis}.spool_loop.controller`, port: "out" });
  expect(from(`${axis}.motor.force`)).toEqual({ block: "load", port: "out" });
  expect(opened.wires.filter((wire) => wire.back).map((wire) => wire.id).filter((id) => id.endsWith("error.in2"))).toHaveLength(6);
  expect([...opened.blocks.keys()].filter((path) => path.endsWith("reference"))).toEqual(["reference"]);
});
