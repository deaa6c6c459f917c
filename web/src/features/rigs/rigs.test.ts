import { describe, expect, it } from "vitest";
import { Problem } from "@/shared/api/problem";
import { calibrationState, presence, type AgentReply } from "./api";
import { hardwareOf, worst } from "./devices";
import { firstDay } from "./firstDay";
import { joined, upTo } from "./live";
import { driveFaults, fieldsOf, liveOf, plainTrigger, requestOf, resolver } from "./request";

const agent = (seen_at: string, has_rig = true) => ({ seen_at, has_rig, time: "2026-11-22T10:01:00Z", lease_seconds: 30 }) as AgentReply;

it("judges an agent by the service's clock", () => {
  expect(presence(agent("2026-11-22T10:00:45Z"))).toBe("ready");
  expect(presence(agent("2026-11-22T10:00:45Z", false))).toBe("waiting");
  expect(presence(agent("2026-11-22T10:00:20Z"))).toBe("away");
});

it.each([
  [undefined, "none"],
  ["2026-11-21", "overdue"],
  ["2026-12-01", "soon"],
  ["2027-03-02", "valid"],
])("a calibration due %s is %s", (due, state) => expect(calibrationState(due === undefined ? undefined : { due }, "2026-11-22")).toBe(state));

describe("live samples", () => {
  it("are put where they belong, gaps stay gaps", () => {
    const first = joined(null, { start: 0, step: 0.1, channels: { p: [[0, 1], [1, 2]] } });
    const both = joined(first, { start: 0.3, step: 0.1, channels: { p: [[4, 5]] } });
    expect([...both.time].map((t) => Number(t.toFixed(6)))).toEqual([0, 0.1, 0.2, 0.3]);
    expect(both.channels.p!.low).toEqual([0, 1, NaN, 4]);
    expect(both.channels.p!.high).toEqual([1, 2, NaN, 5]);
  });

  it("of a sweep have the axis of the whole one while it grows", () => {
    const live = { time: [0, 0.1], channels: { p: { low: [1, 2], high: [3, 4] } } };
    expect(upTo(live, 0.5)).toEqual({ time: [0, 0.1, 0.5], channels: { p: { low: [1, 2, NaN], high: [3, 4, NaN] } } });
    expect(upTo(live, 0.1)).toEqual(live);
  });

  it("of a sweep take the place of what was there", () => {
    const first = joined(null, { start: -0.1, step: 0.1, sweep: 1, channels: { p: [[0, 1], [1, 2]] } });
    expect(joined(first, { start: -0.1, step: 0.1, sweep: 2, channels: { p: [[4, 5]] } })).toEqual({ time: [-0.1], channels: { p: { low: [4], high: [5] } } });
  });
});

it("asks for what the form says, in SI", () => {
  const fields = { name: "run", channels: ["p"], sample_rate: 1000, duration: 2, pre_trigger: 0.1, averages: 3, confirm: true, output: "valve", commanded: false, signal: "chirp" as const, amplitude: 2, frequency: 5, end: 50, trigger: "none" as const, trigger_channel: "", level: 0, high: 1, hysteresis: 0, timeout: 60 };
  expect(requestOf(fields, "bench")).toEqual({
    name: "run", rig: "bench", channels: ["p"], sample_rate: 1000, duration: 2, pre_trigger: 0.1, averages: 3, confirm: true,
    drive: { output: "valve", signal: { kind: "chirp", amplitude: 2, start_frequency: { value: 5, unit: "Hz" }, end_frequency: { value: 50, unit: "Hz" }, duration: 2 } },
  });
  expect(requestOf({ ...fields, output: "" }, "bench")).not.toHaveProperty("drive");
});

it("keeps what an output plays as a channel where it is asked to, and reads it from a template", () => {
  const begin = { ...fieldsOf(undefined, ["p"]), name: "run", output: "valve", commanded: true };
  expect(requestOf(begin, "bench").channels).toEqual(["p", "valve"]);
  expect(requestOf({ ...begin, output: "" }, "bench").channels).toEqual(["p"]);
  expect(liveOf(begin, "bench").channels).toEqual(["p"]);
  const template = requestOf(begin, "bench");
  expect(fieldsOf(template, ["p"])).toMatchObject({ channels: ["p"], output: "valve", commanded: true });
  // An input that has the name of the output is measured.
  expect(fieldsOf(template, ["p", "valve"])).toMatchObject({ channels: ["p", "valve"], commanded: false });
});

describe("the first day", () => {
  const today = "2026-11-22";
  const found = (result: "ok" | "note" | "fails", what: string) => ({ result, what, told: "", remedy: "" });
  const input = { name: "position", channel: "a/ai0", kind: "voltage", unit: "mm", sensitivity: 1, range: 5, calibration: { due: "2027-03-02" } };
  const output = { name: "valve", channel: "a/ao0", kind: "voltage", amplitude: 1, slew: 10, duration: 60, safe: 0, soft_start: 0.1, soft_stop: 0.1 };
  const whole = { inputs: [input], outputs: [output], findings: ["hardware", "device a", "input position", "output valve"].map((what) => found("ok", what)) };
  const of = (document: Parameters<typeof firstDay>[0], change = {}) => firstDay(document, { present: true, recorded: true, today, ...change }).filter((step) => step.result !== "ok");

  it("is over when everything fits and something was recorded", () => {
    expect(of(whole)).toEqual([]);
    expect(of(whole, { present: false, recorded: false })).toEqual([
      { what: "agent", result: "fails", names: [] },
      { what: "recording", result: undefined, names: [] },
    ]);
  });

  it("names what does not fit, is overdue or has no limits", () => {
    const findings = [found("fails", "hardware"), found("note", "device a"), found("fails", "input position"), found("note", "input position"), found("fails", "output valve")];
    const overdue = { ...input, chain: [{ model: "amplifier", serial: "", gain: 1, calibration: { due: "2026-01-01" } }] };
    expect(of({ inputs: [overdue], outputs: [{ ...output, slew: null }], findings })).toEqual([
      { what: "hardware", result: "fails", names: [] },
      { what: "devices", result: "note", names: ["a"] },
      { what: "inputs", result: "fails", names: ["position"] },
      { what: "outputs", result: "fails", names: ["valve"] },
      { what: "calibrations", result: "fails", names: ["position"] },
      { what: "limits", result: "note", names: ["valve"] },
    ]);
  });

  it("says nothing of what nobody has tried, and of outputs that there are not", () => {
    expect(of({ inputs: [{ ...input, calibration: undefined }] }).map((step) => [step.what, step.result])).toEqual([
      ["hardware", undefined],
      ["devices", undefined],
      ["inputs", undefined],
      ["calibrations", "note"],
    ]);
  });
});

it("shows the same channels without a drive, repetitions or a question", () => {
  const begin = { ...fieldsOf(undefined, ["p"]), name: "run", output: "valve", averages: 3, trigger: "rising" as const, trigger_channel: "p", level: 2 };
  expect(liveOf(begin, "bench")).toEqual({ name: "run", rig: "bench", channels: ["p"], sample_rate: 1000, duration: 1, pre_trigger: 0, record: false, trigger: { channel: "p", edge: "rising", level: 2, hysteresis: 0, timeout: 60 } });
});

describe("a trigger", () => {
  const begin = { ...fieldsOf(undefined, ["p", "q"]), name: "run", trigger_channel: "q", level: 2, high: 3, hysteresis: 0.1, timeout: 30 };

  it("is a level or a window of a channel that is measured", () => {
    expect(requestOf({ ...begin, trigger: "falling" }, "bench").trigger).toEqual({ channel: "q", edge: "falling", level: 2, hysteresis: 0.1, timeout: 30 });
    expect(requestOf({ ...begin, trigger: "leaves" }, "bench").trigger).toEqual({ channel: "q", window: [2, 3], when: "leaves", hysteresis: 0.1, timeout: 30 });
    expect(requestOf({ ...begin, channels: ["p"], trigger: "rising" }, "bench").trigger).toMatchObject({ channel: "p" });
  });

  it("is none beside a drive, which begins at once", () => {
    expect(requestOf({ ...begin, trigger: "rising", output: "valve" }, "bench")).not.toHaveProperty("trigger");
    expect(requestOf(begin, "bench")).not.toHaveProperty("trigger");
  });

  it.each([
    [{ trigger: "rising", level: NaN }, ["level"]],
    [{ trigger: "rising", timeout: 3601, hysteresis: -1, high: NaN }, ["hysteresis", "timeout"]],
    [{ trigger: "enters", high: NaN }, ["high"]],
    [{ trigger: "none", level: NaN, timeout: -1 }, []],
    [{ trigger: "rising", level: NaN, output: "valve" }, []],
  ] as const)("is judged where it is shown: %o", async (change, wrong) => {
    const told = await resolver({ ...begin, ...change }, undefined, { fields: {}, shouldUseNativeValidation: false });
    expect(Object.keys(told.errors).sort()).toEqual(wrong);
  });

  it("comes from a template, as it is where it has units of its own", () => {
    const of = (trigger: object) => ({ document: { trigger } }) as unknown as Parameters<typeof plainTrigger>[0];
    const window = { channel: "q", window: [1, 2], when: "enters", timeout: 5 };
    expect(fieldsOf(of(window).document, [])).toMatchObject({ trigger: "enters", trigger_channel: "q", level: 1, high: 2, hysteresis: 0, timeout: 5 });
    expect(fieldsOf(of({ channel: "q", edge: "rising", level: 4 }).document, [])).toMatchObject({ trigger: "rising", level: 4 });
    expect([plainTrigger(of(window)), plainTrigger(of({ ...window, window: [1, { value: 1, unit: "cm" }] }))]).toEqual([true, false]);
  });
});

it("tells what is wrong with a drive at its own field", () => {
  const of = (pointer: string) => driveFaults(new Problem({ title: "", status: 422, detail: "", errors: [{ pointer, detail: "wrong" }] }));
  expect(of("/drive/signal/start_frequency")).toEqual({ frequency: "wrong" });
  expect(of("/drive/signal/end_frequency")).toEqual({ end: "wrong" });
  expect(of("/drive/output")).toEqual({ output: "wrong" });
  expect([of("/drive"), of("/drive/signal/amplitude")]).toEqual([{ amplitude: "wrong" }, { amplitude: "wrong" }]);
  expect([of("/driver"), driveFaults(null)]).toEqual([{}, {}]);
});

it("puts channels below their devices, with what was found of each", () => {
  const found = (result: "ok" | "note" | "fails", what: string) => ({ result, what, told: "", remedy: "" });
  const findings = [found("ok", "hardware"), found("note", "device cDAQ1Mod1"), found("fails", "device cDAQ1Mod1"), found("fails", "input position"), found("ok", "output valve"), found("fails", "device cDAQ1Mod9")];
  const device = (name: string) => ({ name, model: "NI 9234", serial: "01A2" });
  const inputs = [{ name: "position", channel: "cDAQ1Mod1/ai1", kind: "voltage", unit: "mm", sensitivity: 1, range: 5 }, { name: "valve", channel: "cDAQ1Mod10/ai0", kind: "voltage", unit: "V", sensitivity: 1, range: 5 }];
  const output = { name: "valve", channel: "cDAQ1Mod10/ao0", kind: "voltage", amplitude: 1, slew: 1, duration: 1, safe: 0, soft_start: 0, soft_stop: 0 };
  const { branches, others } = hardwareOf({ devices: [device("cDAQ1Mod1"), device("cDAQ1Mod10")], inputs, outputs: [output], findings });
  expect(branches.map((branch) => [worst(branch.findings), branch.channels.map((channel) => [channel.doc, worst(channel.findings)])])).toEqual([
    ["fails", [["cDAQ1Mod1/ai1", "fails"]]],
    [undefined, [["cDAQ1Mod10/ai0", undefined], ["cDAQ1Mod10/ao0", "ok"]]],
  ]);
  expect(others.map((finding) => finding.what)).toEqual(["hardware", "device cDAQ1Mod9"]);
});

it("puts the channels of a controller below it, those of a device that is gone at the end", () => {
  const input = { name: "position", channel: "In1", kind: "voltage", unit: "mm", sensitivity: 1, range: 5 };
  const device = { name: "PLC", model: "", serial: "" };
  expect(hardwareOf({ devices: [device], inputs: [input] }).branches.map((branch) => branch.channels.length)).toEqual([1]);
  expect(hardwareOf({ devices: [device, { ...device, name: "PLC2" }], inputs: [input] }).branches.map((branch) => branch.name)).toEqual(["PLC", "PLC2", "–"]);
});
