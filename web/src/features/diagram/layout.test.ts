// @vitest-environment node
import ELK from "elkjs/lib/elk.bundled.js";
import { expect, it } from "vitest";
import type { ElementEntry, SystemDocument } from "@/shared/api/types";
import manyLoops from "../../../../examples/systems/many_loops.json";
import { elkOf, laidBy, sizeOf, type Laid } from "./layout";
import { portsOf } from "./model";
import { openedOf } from "./opened";

const entry = (kind: string, inputs: string[], outputs: string[]): [string, ElementEntry] => [kind, { kind, inputs, outputs, title: kind, parameters: [], equation: "", source: "", example: { kind } }];
const single = ["gain", "p", "pi", "pid", "low_pass", "feed_forward", "lead_lag", "notch", "rc_network", "transfer_function", "first_order_sensor", "accelerometer", "velocity_transducer"];
const catalogue = new Map([entry("input", [], ["out"]), entry("sum", ["in1", "in2"], ["out"]), entry("linear_hydraulic_motor", ["flow", "force"], ["position", "velocity", "acceleration", "pressure_difference"]), ...single.map((kind) => entry(kind, ["in"], ["out"]))]);
const document = manyLoops as unknown as SystemDocument;
const opened = openedOf(document, catalogue);
// ELK's first picture takes seconds on a busy machine, most of them for its start: that is no part of what is tested.
const laid: Laid = laidBy(await new ELK().layout(elkOf(opened, catalogue)), opened);

it("six nested loops stand in frames inside of frames, each from its sum on the left to its plant on the right", () => {
  const box = (path: string) => ({ ...laid.places[path]!, ...sizeOf(portsOf(opened.blocks.get(path)!, catalogue), opened.blocks.get(path)!.kind) });
  for (const path of opened.blocks.keys()) {
    const frame = laid.frames[path.slice(0, path.lastIndexOf("."))];
    const own = box(path);
    if (frame) expect([own.x >= frame.x, own.y >= frame.y, own.x + own.width <= frame.x + frame.width, own.y + own.height <= frame.y + frame.height]).toEqual([true, true, true, true]);
  }
  // Forward signals lead to the right, the six measurements back to the left.
  for (const wire of opened.wires) expect([wire.id, box(wire.from.block).x < box(wire.to.block).x]).toEqual([wire.id, !wire.back]);
  expect(opened.wires.filter((wire) => wire.back && wire.id.endsWith("error.in2"))).toHaveLength(6);
  // Every signal has a route from its own port to its input's.
  for (const wire of opened.wires) {
    const route = laid.routes[wire.id]!;
    expect(route[0]!.x).toBeCloseTo(box(wire.from.block).x + box(wire.from.block).width, 0);
    expect(route.at(-1)!.x - box(wire.to.block).x).toBeLessThan(45);
  }
});
