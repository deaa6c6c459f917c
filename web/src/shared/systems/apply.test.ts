import { expect, it } from "vitest";
import { withValues } from "./apply";

const document = {
  parameters: { m: { value: 0.3, unit: "daN*s**2/cm" }, k: { value: 2 }, q: { value: { value: 5, unit: "cm" } } },
  blocks: { motor: { kind: "gain", gain: 1 }, inner: { kind: "subsystem", system: { blocks: { lag: { kind: "low_pass", frequency: 10 } }, outputs: { y: "lag" } } } },
  outputs: { y: "motor" },
};

it("writes values in SI at their places, and leaves the author's units and all else", () => {
  const changed = withValues(document, { m: { value: 200, unit: "kg" }, k: { value: 3, unit: "" }, q: { value: 0.1, unit: "m" }, "motor.gain": { value: 4, unit: "1" }, "inner.lag.frequency": { value: 20, unit: "rad/s" } });
  expect(changed.parameters).toEqual({ m: { value: { value: 200, unit: "kg" }, unit: "daN*s**2/cm" }, k: { value: 3 }, q: { value: { value: 0.1, unit: "m" } } });
  expect(changed.blocks).toEqual({ motor: { kind: "gain", gain: 4 }, inner: { kind: "subsystem", system: { blocks: { lag: { kind: "low_pass", frequency: 20 } }, outputs: { y: "lag" } } } });
  expect(document.parameters.k.value).toBe(2);
});
