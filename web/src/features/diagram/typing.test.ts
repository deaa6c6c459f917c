import { describe, expect, it } from "vitest";
import type { ElementEntry, ParameterEntry, SystemDocument } from "@/shared/api/types";
import { blockTyped, kindsLike, matching, readParameter, readTyped, wiresFrom } from "./quick";

const parameter = (name: string, unit: string, more: object = {}) => ({ name, unit, required: true, shape: "scalar", ...more }) as unknown as ParameterEntry;
const entry = (kind: string, title: string, inputs: string[], outputs: string[], parameters: ParameterEntry[] = [], example: object = {}): [string, ElementEntry] => [kind, { kind, title, inputs, outputs, parameters, equation: "", source: "", example: { kind, ...example } } as unknown as ElementEntry];
const catalogue = new Map([
  entry("input", "Input", [], ["out"]),
  entry("pi", "PI controller", ["in"], ["out"], [parameter("kp", ""), parameter("ki", "", { required: false }), parameter("integral_time", "s", { required: false })], { kp: 2, ki: 5 }),
  entry("pid", "PID controller", ["in"], ["out"]),
  entry("sum", "Sum", ["in1", "in2"], ["out"], [parameter("signs", "", { shape: "text" })], { signs: "+-" }),
  entry("transfer_function", "Transfer function", ["in"], ["out"], [parameter("numerator", "", { shape: "list" }), parameter("denominator", "", { shape: "list" })], { numerator: [1], denominator: [1, 1] }),
  entry("motor", "Hydraulic motor", ["flow", "force"], ["position", "velocity"], [parameter("area", "m**2"), parameter("stroke", "m")]),
]);
const empty: SystemDocument = { blocks: {}, outputs: {} };
const typed = (text: string, document = empty) => {
  const read = readTyped(text);
  return blockTyped(read, kindsLike(read.kind, catalogue)[0]!, document);
};

describe("a typed block", () => {
  it.each([
    ["pi", "pi", { kind: "pi", kp: 2, ki: 5 }],
    ["controller: pi kp=35 ki=100", "controller", { kind: "pi", kp: 35, ki: 100 }],
    ["PI controller kp=2.4k", "pi", { kind: "pi", kp: 2400 }],
    ["pi kp==2*k integral_time=330 m", "pi", { kind: "pi", kp: "=2*k", integral_time: 0.33 }],
    ["error: sum signs=++", "error", { kind: "sum", signs: "++" }],
    ["coil: transfer fun numerator=1 denominator=0.015, 20", "coil", { kind: "transfer_function", numerator: [1], denominator: [0.015, 20] }],
    ["motor area=20 cm**2 stroke=12 mm", "motor", { kind: "motor", area: { value: 20, unit: "cm**2" }, stroke: 0.012 }],
  ])("%s", (text, name, block) => expect(typed(text)).toEqual({ name, block }));
  it("gets the next free name", () => expect(typed("pi", { blocks: { pi: { kind: "pi" } }, outputs: {} })).toMatchObject({ name: "pi_2" }));
  it.each([
    ["Motor 1: pi", { key: "Motor 1", rule: "name" }],
    ["pi kd=3", { key: "kd", place: "pi", rule: "parameter" }],
    ["pi kp=a lot", { key: "kp", rule: "value" }],
    ["transfer_function numerator=s+1", { key: "numerator", rule: "value" }],
  ])("%s is refused by what is wrong", (text, refusal) => expect(typed(text)).toEqual(refusal));
  it("must not have another's name", () => expect(typed("m: pi", { blocks: { m: { kind: "pi" } }, outputs: {} })).toEqual({ key: "m", rule: "taken" }));
});

it("finds the kind itself before those that only begin so", () => {
  expect(kindsLike("pi", catalogue).map((found) => found.kind)).toEqual(["pi", "pid"]);
  expect(kindsLike("hydraulic", catalogue).map((found) => found.kind)).toEqual(["motor"]);
  expect(kindsLike("wheel", catalogue)).toEqual([]);
});

describe("typed connections", () => {
  const document: SystemDocument = { blocks: { r: { kind: "input" }, e: { kind: "sum", signs: "+-" }, m: { kind: "motor" } }, connections: [{ from: "r", to: "e.in1" }], outputs: {} };
  it("name the ports, free ones first", () =>
    expect(wiresFrom("m", document, catalogue).map((wire) => [wire.label, wire.instead])).toEqual([
      ["position → e.in2", undefined],
      ["position → m.flow", undefined],
      ["position → m.force", undefined],
      ["velocity → e.in2", undefined],
      ["velocity → m.flow", undefined],
      ["velocity → m.force", undefined],
      ["position → e.in1", "r"],
      ["velocity → e.in1", "r"],
    ]));
  it("are found by any of their words, whole words first", () => {
    const label = (wire: { label: string }) => wire.label;
    expect(matching(wiresFrom("m", document, catalogue), label, "velocity > e.in2")[0]!.label).toBe("velocity → e.in2");
    expect(matching(wiresFrom("r", document, catalogue), label, "force").map(label)).toEqual(["m.force"]);
    expect(matching(wiresFrom("r", document, catalogue), label, "nowhere")).toEqual([]);
  });
});

describe("a typed parameter", () => {
  it.each([
    ["kp", { value: 1 }],
    ["kp = 2.4k", { value: 2400 }],
    ["area = 20 cm**2", { value: 20, unit: "cm**2" }],
    ["t = 28 ms [0, 50]", { value: 28, unit: "ms", lower: 0, upper: 50 }],
    ["kp = 12 [1, 10k]", { value: 12, lower: 1, upper: 1e4 }],
    ["kp = 12 [, 20]", { value: 12, upper: 20 }],
    ["kd = kp/20", { value: "=kp/20" }],
  ])("%s", (text, expected) => expect(readParameter(text)).toEqual({ name: text.split(" ")[0], parameter: expected }));
  it.each(["kp =", "kp = 1 [2", "kp = 1..2"])("%s is none", (text) => expect(readParameter(text).parameter).toBeUndefined());
});
