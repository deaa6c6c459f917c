import { describe, expect, it } from "vitest";
import { partsOf, readParts, readRanges } from "./structures";

describe("structures by their parts", () => {
  it("names what a system can do without", () =>
    expect(partsOf({ blocks: { u: { kind: "input" }, g: { kind: "gain" } }, connections: [{ from: "u", to: "g" }], outputs: { y: "g" } })).toEqual({ blocks: ["u", "g"], connections: ["u → g"] }));
  it("reads what the diagram copies, and nothing that is no part of a system", () => {
    expect(readParts('{"blocks": {"f": {"kind": "low_pass"}}, "connections": [{"from": "u", "to": "f"}], "outputs": {}}')).toEqual({ blocks: { f: { kind: "low_pass" } }, connections: [{ from: "u", to: "f" }] });
    for (const text of ["", "{", "[]", "{}", '{"blocks": []}', '{"connections": [{"from": 1, "to": "f"}]}']) expect(readParts(text)).toBeUndefined();
  });
  it("reads ranges with units", () => {
    expect(readRanges("lead.zero = 1 ... 100; m=2 kg … 5 kg")).toEqual([
      { parameter: "lead.zero", lower: 1, upper: 100 },
      { parameter: "m", lower: { value: 2, unit: "kg" }, upper: { value: 5, unit: "kg" } },
    ]);
    expect(readRanges("lead.zero = 1")).toBeUndefined();
    expect(readRanges("")).toEqual([]);
  });
});
