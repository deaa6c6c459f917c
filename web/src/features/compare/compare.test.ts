import { describe, expect, it } from "vitest";
import type { Metric } from "@/shared/api/types";
import { compareAt, readDesigns } from "@/shared/systems/compared";
import { common, labelsOf, type Design } from "./designs";
import { frameOf, openedOf, rowsOf, tableCsv } from "./overlaid";
import { asCommand } from "./recorded";
import { axesOf, type Drawn } from "./study";

const design = (part: Partial<Design>): Design => ({ id: "sys_a@1", name: "lag", part: "revision 1", to: "", document: { blocks: {}, outputs: {} }, values: {}, inputs: ["u"], outputs: new Map([["y", "m"]]), loops: [], parameters: new Map(), nonlinear: false, ...part });

describe("the address of a comparison", () => {
  it("comes back as it was written, each design once", () => {
    const refs = [{ kind: "revision", id: "sys_a", revision: 3 }, { kind: "job", id: "job_b" }] as const;
    const query = new URLSearchParams(compareAt([...refs, refs[0]]).split("?")[1]);
    expect(readDesigns(query)).toEqual(refs);
  });
  it("is not read where it names nothing", () => expect(readDesigns(new URLSearchParams("d=sys_a&d=sys_a@0&d=x@1&d=ds_a&d="))).toEqual([]));
});

describe("axes of all designs", () => {
  const measured = [
    { metrics: {}, end: 2, frequencies: [0.1, 100] as [number, number] },
    { metrics: {}, end: 5, frequencies: [1, 1000] as [number, number] },
  ];
  it("reach as far as any of them, in equal steps of the logarithm", () => {
    const { end, frequencies } = axesOf(measured, 5);
    expect(end).toBe(5);
    frequencies.forEach((w, i) => expect(w).toBeCloseTo(10 ** (i - 1), 10));
    expect([frequencies[0], frequencies[4]]).toEqual([0.1, 1000]);
  });
  it("have no frequencies where nothing has a response", () => expect(axesOf([{ metrics: {}, end: 1, frequencies: null }]).frequencies).toEqual([]));
});

it("what all have in common is in the order of the first", () => expect(common([["a", "b", "c"], ["c", "a"]])).toEqual(["a", "c"]));

it("labels tell designs apart, and leave the name of the system out where it is the same", () => {
  const two = [design({}), design({ part: "revision 2" }), design({})];
  expect(labelsOf(two, true)).toEqual(["revision 1", "revision 2", "revision 1 (2)"]);
  expect(labelsOf([two[0]!, design({ name: "motor" })], true)).toEqual(["lag, revision 1", "motor, revision 1"]);
});

describe("curves laid over each other", () => {
  const designs = [design({}), design({ outputs: new Map([["y", "mm"], ["v", "m/s"]]) })];
  const opened = openedOf(designs, [], 1);
  const axes = { end: 1, frequencies: [1, 2] };
  const drawn: Drawn[] = [
    { verdict: "ok", outputs: { y: [0, 1, null] }, re: [1, 0.5], im: [0, -0.5], poles: [{ real: -1, imag: 0 }] },
    { verdict: "unstable", outputs: { y: [7, 7, 7], v: [1, 2, 3] }, re: [], im: [], poles: [] },
  ];
  const frame = frameOf(1, opened, designs, drawn, axes, 3);
  it("have the outputs of all, in the unit of the first", () => expect(opened.outputs).toEqual([{ name: "y", unit: "m" }, { name: "v", unit: "m/s" }]));
  it("are NaN where a design has none, or has it in another unit", () => {
    expect([...frame.outputs(0, 0)]).toEqual([0, 1, NaN]);
    expect([...frame.outputs(0, 1)]).toEqual([NaN, NaN, NaN]);
    expect([...frame.outputs(1, 0)]).toEqual([NaN, NaN, NaN]);
    expect([...frame.outputs(1, 1)]).toEqual([1, 2, 3]);
    expect([...frame.response(1).re]).toEqual([NaN, NaN]);
  });
  it("share their axes", () => {
    expect([...frame.time]).toEqual([0, 0.5, 1]);
    expect([...frame.poles(0).re]).toEqual([-1]);
  });
});

describe("a recorded curve", () => {
  const overlay = { output: "y", start: 0.5, relative: true };
  it("is measured from its start on, without its gaps, from its first value where that is wanted", () =>
    expect(asCommand([0.4, 0.5, 0.6, 0.7, 0.8], [9, 2, null, 5, 6], overlay)).toMatchObject({ input: { signal: { time: [0, expect.closeTo(0.2), expect.closeTo(0.3)], values: [0, 3, 4] } }, duration: expect.closeTo(0.3) }));
  it("of fewer than two samples has no metrics", () => expect(asCommand([0.4, 0.5], [1, 2], overlay)).toBeNull());
});

describe("the table", () => {
  const parameters = (tau: number, more: [string, { value: number; unit: string }][] = []) => new Map([["k", { value: 2, unit: "1" }], ["tau", { value: tau, unit: "s" }], ...more]);
  const designs = [{ parameters: parameters(0.1) }, { parameters: parameters(0.2, [["law.kp", { value: 3, unit: "" }]]) }];
  const metrics: Record<string, Metric>[] = [{ rise_time: { value: 0.1 * Math.log(9), unit: "s", verdict: "ok" } }, { rise_time: { value: null, unit: "s", verdict: "never_crosses" }, overshoot: { value: 0, unit: "1", verdict: "ok" } }];
  const rows = rowsOf(designs, metrics, ["rise_time", "bandwidth", "overshoot"]);
  it("has metrics that any design has, and parameters that differ", () => {
    expect(rows.map(({ kind, name }) => [kind, name])).toEqual([["metric", "rise_time"], ["metric", "overshoot"], ["parameter", "tau"], ["parameter", "law.kp"]]);
    expect(rows[3]!.cells).toEqual([null, { value: 3, unit: "", verdict: "ok" }]);
  });
  it("has a column of metrics for a recording, which has no parameters", () => {
    const recorded: Record<string, Metric> = { rise_time: { value: 0.2, unit: "s", verdict: "ok" } };
    expect(rowsOf(designs, [...metrics, recorded], ["rise_time"]).map(({ cells }) => [cells.length, cells[2]?.value ?? null])).toEqual([[3, 0.2], [3, null], [3, null]]);
  });
  it("is exported in SI, with a verdict where there is no value", () => {
    expect(tableCsv(['one "1"', "two"], rows, { property: "property", unit: "unit" }).split("\n")).toEqual([
      '"property","unit","one ""1""","two"',
      `"rise_time","s",${0.1 * Math.log(9)},"never_crosses"`,
      '"overshoot","1",,0',
      '"tau","s",0.1,0.2',
      '"law.kp","",,3',
      "",
    ]);
  });
});
