import { expect, it } from "vitest";
import { differences } from "./difference";

const base = {
  name: "loop",
  blocks: { u: { kind: "input" }, motor: { kind: "gain", gain: { value: 65, unit: "cm**2" } } },
  connections: [{ from: "u", to: "motor" }],
  outputs: { y: "motor" },
};

it("is nothing for another order", () => expect(differences(base, { ...base, blocks: { motor: base.blocks.motor, u: base.blocks.u } })).toEqual([]));

it("names values with their units, blocks by their kind, connections as arrows", () => {
  const after = { ...base, blocks: { ...base.blocks, motor: { kind: "gain", gain: 2 }, lag: { kind: "low_pass", frequency: 10 } }, connections: [{ from: "u", to: "lag" }] };
  expect(differences(base, after)).toEqual([
    { place: "blocks.motor.gain", kind: "changed", before: "65 cm**2", after: "2" },
    { place: "blocks.lag", kind: "added", after: "low_pass" },
    { place: "connections.u → motor", kind: "removed", before: "" },
    { place: "connections.u → lag", kind: "added", after: "" },
  ]);
});
