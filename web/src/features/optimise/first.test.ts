import { afterEach, describe, expect, it } from "vitest";
import type { SystemDocument } from "@/shared/api/types";
import type { LiveParameter, Opened } from "@/shared/live/protocol";
import { keepLast, lastOf } from "@/shared/systems/last";
import { effortOf, gainsOf } from "@/shared/systems/controllers";
import { firstOf } from "./first";
import { drawnGoals } from "./drawn";

const p = (path: string, value: number, more: Partial<LiveParameter> = {}): LiveParameter => ({ path, value, unit: "1", lower: null, upper: null, scale: "linear", doc: "", bound: false, ...more });
const document: SystemDocument = {
  parameters: { stiffness: { value: 3 } },
  blocks: {
    reference: { kind: "input" },
    error: { kind: "sum", signs: "+-" },
    forward: { kind: "feed_forward", kv: 1 },
    law: { kind: "pid", kp: "=stiffness*2", ki: 4, kd: 0 },
    late: { kind: "delay", time: 0.001 },
    limit: { kind: "saturation", lower: -12, upper: 10 },
    motor: { kind: "dc_motor" },
  },
  connections: [
    { from: "reference", to: "error.in1" },
    { from: "motor.speed", to: "error.in2" },
    { from: "error", to: "law" },
    { from: "law", to: "late" },
    { from: "late", to: "limit" },
    { from: "limit", to: "motor.voltage" },
  ],
  outputs: { speed: "motor.speed", voltage: "law" },
};
const opened = {
  inputs: ["reference"],
  outputs: [{ name: "speed", unit: "rad/s" }, { name: "voltage", unit: "V" }],
  parameters: [p("stiffness", 3), p("forward.kv", 1), p("law.kp", 6, { bound: true }), p("law.ki", 4), p("law.kd", 0), p("limit.lower", -12), p("limit.upper", 10)],
} as unknown as Opened;

describe("what a form begins with", () => {
  it("varies the controller's gains, by the author's parameter where one stands for them, and not the first three", () => expect(gainsOf(document, opened.parameters)).toEqual(["stiffness", "law.ki"]));
  it("takes the outermost loop's of several, and a plain factor behind a difference for a law", () => {
    const inner: SystemDocument = { ...document, blocks: { ...document.blocks, law: { kind: "gain", gain: 2 } } };
    expect(gainsOf({ blocks: { axis: { kind: "subsystem", system: inner } }, connections: [], outputs: {} }, [p("axis.law.gain", 2)])).toEqual(["axis.law.gain"]);
  });
  it("finds the limit that the plant states behind a delay, and says whose it is", () => expect(effortOf(document, opened, "speed")).toEqual({ metric: "control_effort", output: "voltage", limit: { value: 10, by: "limit.upper" } }));
  it("bounds the acceleration where no output carries the effort, and nothing of what has none", () => {
    const bare = { ...document, outputs: { speed: "motor.speed" } };
    expect(effortOf(bare, opened, "speed")).toEqual({ metric: "max_acceleration", output: "speed", limit: null });
    expect(effortOf(bare, { ...opened, outputs: [{ name: "speed", unit: "V" }] }, "speed")).toBeNull();
  });
  it("takes the panel's input, amplitude, goals and values", () => {
    const form = firstOf(opened, document, ["error"], { input: "reference", amplitude: 0.01, loop: "error", output: "speed", goals: [{ metric: "overshoot", output: "speed", sense: "", upper: 0.2 }], values: { "law.ki": 5 } }, { metric: "control_effort", output: "voltage", limit: null, upper: 24 });
    expect(form.experiments[0]!.commands[0]).toEqual({ port: "reference", signal: { kind: "step", amplitude: 0.01 } });
    expect(form.goals.map(({ metric, upper }) => [metric, upper])).toEqual([["response_time", undefined], ["overshoot", 0.2], ["control_effort", 24]]);
    expect(form.variables.map(({ parameter, start }) => [parameter, start])).toEqual([["stiffness", undefined], ["law.ki", 5]]);
  });
  it("draws the bounds of the looked-at output, the first of each metric", () => {
    const goal = (metric: string, output: string, upper: number) => ({ metric, output, experiment: "", from: "", loop: "", sense: "" as const, upper, soft: false });
    expect(drawnGoals([goal("overshoot", "speed", 0.1), goal("overshoot", "speed", 0.2), goal("overshoot", "voltage", 0.3), goal("control_effort", "voltage", 24)], "speed")).toEqual([
      { metric: "overshoot", bound: "upper", value: 0.1, row: 0 },
      { metric: "control_effort", bound: "upper", value: 24, row: 3, output: "voltage" },
    ]);
  });
});

describe("what a browser remembers of panels", () => {
  afterEach(() => localStorage.clear());
  const last = (query: string) => ({ query, search: { input: "u", amplitude: 1, loop: "", goals: [], output: "y", values: {} } });
  it("is the last of each system, of forty systems", () => {
    for (let i = 0; i < 45; i++) keepLast(`sys_${i}`, last(`s=${i}`));
    keepLast("sys_44", last("s=new"));
    expect(lastOf("sys_44")?.query).toBe("s=new");
    expect([lastOf("sys_4"), lastOf("sys_5")?.query]).toEqual([null, "s=5"]);
  });
  it("is nothing where what is kept cannot be read", () => {
    localStorage.setItem("servotune.panels", '{"a":1}');
    expect(lastOf("a")).toBeNull();
    localStorage.setItem("servotune.panels", "[[");
    expect(lastOf("a")).toBeNull();
  });
});
