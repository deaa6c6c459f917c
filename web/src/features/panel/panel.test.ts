import { describe, expect, it } from "vitest";
import type { LiveParameter } from "@/shared/live/protocol";
import { fromPosition, keyPosition, toPosition, travelOf } from "./scale";
import { firstSliders } from "@/shared/systems/movable";
import { readState, variantsOf, writeState } from "./state";

const parameter = (path: string, value: number, more: Partial<LiveParameter> = {}): LiveParameter => ({ path, value, unit: "ohm", lower: null, upper: null, scale: "linear", doc: "", bound: false, ...more });

describe("the address", () => {
  const text = "s=r,kp&p.r=0.4&cmp=r%3A0.33%2C0.5&ref=1&r.kp=2&in=u&amp=24&out=y&path=u%2Cy&T=0.5&v=step%3Ay%2Cbode&k=kp&rl=kp&pl=kp&log=r&g=overshoot%3C0.05%2Cphase_margin%3E0.785&sn=a%20b~1~r%3D0.3&ds=y~ds_1~ch~0.5~1&ms=iae%2Covershoot&m=iae";
  it("holds the state", () => {
    const state = readState(new URLSearchParams(text));
    expect(state).toEqual({ sliders: ["r", "kp"], values: { r: 0.4 }, compare: { path: "r", values: [0.33, 0.5] }, reference: { kp: 2 }, input: "u", amplitude: 24, output: "y", loop: null, path: ["u", "y"], duration: 0.5, plots: ["step:y", "bode"], metrics: ["iae", "overshoot"], metric: "iae",
      knobs: ["kp"], locus: "kp", pull: "kp", scales: { r: "log" }, goals: [{ metric: "overshoot", bound: "upper", value: 0.05 }, { metric: "phase_margin", bound: "lower", value: 0.785 }], snapshots: [{ name: "a b", shown: true, values: { r: 0.3 } }], measured: [{ output: "y", dataset: "ds_1", channel: "ch", start: 0.5, relative: true }] });
    expect(readState(writeState(state, new URLSearchParams()))).toEqual(state);
  });
  it("forgives what makes no sense", () => expect(readState(new URLSearchParams("p.r=abc&T=-1&cmp=r:x&amp=0&g=overshoot%3Cx,nothing%3C1&sn=a~1~r%3Dx&ds=y~~c&ms=nothing"))).toMatchObject({ metrics: null, values: {}, duration: null, compare: null, amplitude: 1, goals: [], snapshots: [], measured: [] }));
  it("keeps what belongs to others", () => expect(writeState(readState(new URLSearchParams()), new URLSearchParams("other=1&p.r=2")).toString()).toBe("other=1"));
});

describe("sliders", () => {
  it("stay within the author's bounds", () => expect(travelOf(parameter("r", 1, { lower: 0.5, upper: 4 }))).toEqual({ low: 0.5, high: 4, log: false }));
  it("span a factor of five where there are none", () => expect(travelOf(parameter("r", 2))).toEqual({ low: 0.4, high: 10, log: true }));
  it("do not search down to a physical bound of 0", () => expect(travelOf(parameter("r", 2, { lower: 0, upper: 1e9 })).low).toBe(0.4));
  it("have a range at 0 and below", () => {
    expect(travelOf(parameter("r", 0))).toEqual({ low: -1, high: 1, log: false });
    expect(travelOf(parameter("r", -2))).toEqual({ low: -10, high: -0.4, log: false });
  });
  it("are linear or logarithmic as is wished, where they can be", () => {
    expect(travelOf(parameter("r", 2), "linear").log).toBe(false);
    expect(travelOf(parameter("r", 1, { lower: 0.5, upper: 4 }), "log").log).toBe(true);
    expect(travelOf(parameter("r", 0), "log").log).toBe(false);
  });
  it("find their way back", () => {
    const travel = { low: 0.1, high: 10, log: true };
    expect(toPosition(1, travel)).toBeCloseTo(0.5);
    expect(fromPosition(0.5, travel)).toBe(1);
    expect([fromPosition(0, travel), fromPosition(1, travel)]).toEqual([0.1, 10]);
  });
  it("follow the keys", () => {
    expect(keyPosition("ArrowRight", 0.5, { shift: false, alt: false })).toBeCloseTo(0.51);
    expect(keyPosition("ArrowLeft", 0.5, { shift: true, alt: false })).toBeCloseTo(0.4);
    expect(keyPosition("ArrowUp", 0.5, { shift: false, alt: true })).toBeCloseTo(0.501);
    expect(keyPosition("End", 0.5, { shift: false, alt: false })).toBe(1);
    expect(keyPosition("a", 0.5, { shift: false, alt: false })).toBeNull();
  });
});

it("snapshots that are shown are drawn between the reference and the comparisons", () => {
  const parameters = new Map([parameter("r", 1)].map((p) => [p.path, p]));
  const state = readState(new URLSearchParams("s=r&cmp=r:2&ref=1&sn=kept~1~r%3D7&sn=hidden~0~r%3D8"));
  expect(variantsOf(state, parameters, {}, { current: "now", reference: "pinned" }, (path, value) => `${path} = ${value}`).variants.map((v) => [v.label, ...v.vector])).toEqual([["now", 1], ["pinned", 1], ["kept", 7], ["r = 2", 2]]);
});

it("a first panel shows the author's parameters, then the blocks'", () => expect(firstSliders([parameter("m.a", 1), parameter("kp", 1), parameter("m.b", 1, { bound: true }), parameter("m.zero", 0)], 2)).toEqual(["kp", "m.a"]));

it("comparisons follow the moving values, the reference does not", () => {
  const parameters = new Map([parameter("r", 1), parameter("k", 5)].map((p) => [p.path, p]));
  const state = { ...readState(new URLSearchParams("s=r,k&cmp=r:2,3&ref=1&r.k=6")) };
  const { paths, variants } = variantsOf(state, parameters, { k: 9 }, { current: "now", reference: "pinned" }, (path, value) => `${path} = ${value}`);
  expect(paths).toEqual(["r", "k"]);
  expect(variants.map((v) => [v.label, ...v.vector])).toEqual([["now", 1, 9], ["pinned", 1, 6], ["r = 2", 2, 9], ["r = 3", 3, 9]]);
});
