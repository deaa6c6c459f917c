import { expect, it } from "vitest";
import { frfRequest, frfSchema, readFrf, writeFrf } from "./frf";
import { withParameters } from "@/shared/forms/address";
import { fieldsOf, firstOf, groupsOf, importOf, importSchema, layoutOf, readDraft, withGroup, writeDraft, type Look } from "./importing";
import { drawnOf, stretchOf, usualSegment } from "./recording";

const look: Look = {
  series: [
    { index: 0, name: "Time", sample_count: 5, unit: "s", role: "time" },
    { index: 1, name: "Force", sample_count: 5, unit: "N", role: "channel" },
    { index: 2, name: "Count", sample_count: 5, unit: "", role: "counter" },
  ],
  refused: {},
  import: { delimiter: ";", decimal: ",", thousands: ".", comment: "#", header_lines: 2, missing: ["", "NaN"], allow_truncated: false, columns: [{ index: 1, name: "force", unit: "kN", scale: 0.5, offset: 0, quantity: "" }], time: { index: 0, unit: "s" }, gaps: "fill", uneven: "keep", time_zone: "UTC" },
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

const column = (source: string, name: string) => ({ source, name, unit: "N", quantity: "", scale: 1, offset: 0 });
const grouped: Look = {
  ...look,
  series: [
    { index: 0, name: "fast/force", sample_count: 1000, unit: "N", role: "channel" },
    { index: 1, name: "temperature", sample_count: 77, unit: "degC", role: "channel" },
    { index: 2, name: "slow/force", sample_count: 77, unit: "N", role: "channel" },
  ],
  import: { columns: [column("fast/force", "force")], sample_rate: 1000, gaps: "fill", time_zone: "UTC", group: "fast" },
  groups: [
    { name: "fast", sample_rate: 1000, sample_count: 1000, columns: [column("fast/force", "force")], first: [[1, 2]] },
    { name: "slow", sample_rate: 10, sample_count: 77, columns: [column("temperature", "oil"), column("slow/force", "force")], first: [[20], [5]] },
  ],
};

it("takes all groups of a file, some of them, or some channels of one", () => {
  const fields = fieldsOf(grouped);
  expect(importSchema.safeParse(fields).success).toBe(true); // names may be those of another group
  expect(importOf(fields, false).columns?.map(({ index, name }) => [index, name])).toEqual([[0, "force"], [1, "oil"], [2, "force"]]);
  expect(importOf(fields, false)).not.toHaveProperty("group");
  expect(importOf(fields, false).sample_rate).toBe(1000);
  const slow = { ...fields, columns: withGroup(fields.columns, "fast", false) };
  expect(importOf(slow, false).columns?.map(({ index }) => index)).toEqual([1, 2]);
  expect(importOf(slow, false)).not.toHaveProperty("sample_rate"); // it is that of the group that is left out
  const some = { ...fields, columns: fields.columns.map((column) => (column.index === 1 ? { ...column, take: false } : column)) };
  expect(groupsOf(grouped, some.columns).map(({ name, channels, taken }) => [name, channels, taken])).toEqual([["fast", 1, 1], ["slow", 2, 1]]);
  expect(firstOf(grouped, 2)).toEqual([5]);
});

it("keeps uneven instants, or resamples them to a rate that it asks for", () => {
  const fields = fieldsOf({ ...look, import: { ...look.import, uneven: { resample: { rate: 500, method: "cubic" } } } });
  expect(importOf(fields, true).uneven).toEqual({ resample: { rate: 500, method: "cubic" } });
  const asked = importSchema.safeParse({ ...fields, uneven_rate: undefined });
  expect(asked.error?.issues.map((issue) => [issue.path.join("."), issue.message])).toEqual([["uneven_rate", "forms.required"]]);
  expect(importOf({ ...fields, uneven: "keep" }, true).uneven).toBe("keep");
  expect(importOf({ ...fields, time: "" }, true)).not.toHaveProperty("uneven");
});
