import { expect, it } from "vitest";
import { frfRequest, frfSchema, readFrf, writeFrf } from "./frf";
import { withParameters } from "@/shared/forms/address";
import { fieldsOf, importOf, importSchema, layoutOf, readDraft, writeDraft, type Look } from "./importing";
import { drawnOf, stretchOf, usualSegment } from "./recording";

const look: Look = {
  series: [
    { index: 0, name: "Time", sample_count: 5, unit: "s", role: "time" },
    { index: 1, name: "Force", sample_count: 5, unit: "N", role: "channel" },
    { index: 2, name: "Count", sample_count: 5, unit: "", role: "counter" },
  ],
  refused: {},
  import: { delimiter: ";", decimal: ",", thousands: ".", comment: "#", header_lines: 2, missing: ["", "NaN"], allow_truncated: false, columns: [{ index: 1, name: "force", unit: "kN", scale: 0.5, offset: 0, quantity: "" }], time: { index: 0, unit: "s" }, gaps: "fill", time_zone: "UTC" },
  channels: [{ name: "force", unit: "kN", first: [1, 2, 3] }],
  sample_rate: 1000,
  sample_count: 5,
  uneven: 0,
  start_time: null,
  scalars: {},
  remarks: [],
};

it("shows every series, takes those proposed, and says the same again", () => {
  const fields = fieldsOf(look);
  expect(fields.columns.map((column) => column.take)).toEqual([false, true, false]);
  expect(importOf(fields, true)).toEqual({ ...look.import, columns: look.import!.columns });
});

it("holds in the address what was changed in a proposal, column by column", () => {
  const begin = fieldsOf(look);
  const changed = { ...begin, header_lines: 5, sample_rate: 50, columns: begin.columns.map((column) => (column.index === 2 ? { ...column, take: true, unit: "kN", scale: NaN } : column)) };
  const query = withParameters(new URLSearchParams("look=job_1"), writeDraft(changed, begin));
  expect(query.toString()).toBe("look=job_1&header_lines=5&sample_rate=50&2.take=true&2.unit=kN&2.scale=");
  expect(readDraft(query, begin)).toEqual(changed);
});

it("says nothing of a layout that a file has none of", () => {
  const { delimiter, decimal, header_lines } = importOf(fieldsOf(look), false);
  expect([delimiter, decimal, header_lines]).toEqual([undefined, undefined, undefined]);
  expect(layoutOf(fieldsOf(look))).not.toHaveProperty("columns");
});

it("asks for names that differ, and for a rate where there are no instants", () => {
  const fields = fieldsOf(look);
  const twice = { ...fields, columns: fields.columns.map((column) => ({ ...column, take: column.index > 0, name: "x" })), time: "" };
  const found = importSchema.safeParse(twice);
  expect(found.error?.issues.map((issue) => [issue.path.join("."), issue.message])).toEqual([["columns.1.name", "importing.twice"], ["columns.2.name", "importing.twice"], ["sample_rate", "importing.needRate"]]);
});

it("keeps what is estimated in the address", () => {
  const fields = { ...readFrf(new URLSearchParams(), ["force", "a"]), segment: 2, modes: true };
  expect(readFrf(writeFrf(fields), ["force", "a"])).toEqual(fields);
  expect(frfRequest("ds_1", fields)).toEqual({ dataset: "ds_1", input: "force", output: ["a"], estimator: "H1", window: "hann", segment: 2, confidence: 0.95, modes: {} });
});

it("asks for stepped sines one after the other, and holds a model against them", () => {
  const fields = { ...readFrf(new URLSearchParams(), ["force", "a"]), estimator: "stepped_sine" as const, frequencies: "5 Hz; 62.8", dwell: 2, begin: 1, settle: 0.5, system: "sys_1", from: "u", to: "y" };
  expect(readFrf(writeFrf(fields), ["force", "a"])).toEqual(fields);
  expect(frfRequest("ds_1", fields)).toEqual({
    dataset: "ds_1",
    input: "force",
    output: ["a"],
    estimator: "stepped_sine",
    steps: [{ frequency: { value: 5, unit: "Hz" }, start: 1, end: 3 }, { frequency: 62.8, start: 3, end: 5 }],
    settle: 0.5,
    confidence: 0.95,
    system: "sys_1",
    from: "u",
    to: "y",
  });
  const faults = (changed: object) => (frfSchema.safeParse({ ...fields, ...changed }).error?.issues ?? []).map((issue) => issue.path.join("."));
  expect([faults({}), faults({ frequencies: "five" }), faults({ dwell: undefined }), faults({ to: "" })]).toEqual([[], ["frequencies"], ["dwell"], ["to"]]);
});

it("averages a long stretch over segments, and takes a short one as it is", () => {
  // 131072 samples are 13.1072 s at 10 kHz.
  expect(usualSegment(0, 1000, 10_000)).toBe(13.1072);
  expect(usualSegment(990, 1003.2, 10_000)).toBe(13.1072);
  expect(usualSegment(990, 1003, 10_000)).toBeUndefined();
  expect(usualSegment(0, 131_072, 1)).toBeUndefined();
  expect(usualSegment(0, 1000, null)).toBeUndefined();
});

it("takes no segment that the experiments of a stretch could not hold", () => {
  const counts = [200_000, 200_000, 60_000]; // to 20, 40 and 46 s
  expect(usualSegment(0, 40, 10_000, counts)).toBe(13.1072);
  expect(usualSegment(10, 30, 10_000, counts)).toBeUndefined();
  expect(usualSegment(0, 46, 10_000, counts)).toBeUndefined();
});

it.each([
  ["", [0, 10]],
  ["from=2&to=3.5", [2, 3.5]],
  ["from=-1&to=99", [0, 10]],
  ["from=8", [8, 10]],
  ["from=5&to=2", [0, 10]],
  ["from=x", [0, 10]],
])("looks, of ten seconds, for %s at %s", (query, stretch) => expect(stretchOf(new URLSearchParams(query), 10)).toEqual(stretch));

it("draws the channels that are chosen, or the first ones", () => {
  const names = Array.from({ length: 12 }, (_, i) => `c${i}`);
  expect(drawnOf(new URLSearchParams(), names)).toEqual(names.slice(0, 8));
  expect(drawnOf(new URLSearchParams("show=c11&show=c3&show=gone"), names)).toEqual(["c3", "c11"]);
});
