import { describe, expect, it } from "vitest";
import { Problem } from "@/shared/api/problem";
import { calibrationState, presence, type AgentReply } from "./api";
import { joined } from "./live";
import { driveFaults, requestOf } from "./request";

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
});

it("asks for what the form says, in SI", () => {
  const fields = { name: "run", channels: ["p"], sample_rate: 1000, duration: 2, pre_trigger: 0.1, averages: 3, confirm: true, output: "valve", signal: "chirp" as const, amplitude: 2, frequency: 5, end: 50 };
  expect(requestOf(fields, "bench")).toEqual({
    name: "run", rig: "bench", channels: ["p"], sample_rate: 1000, duration: 2, pre_trigger: 0.1, averages: 3, confirm: true,
    drive: { output: "valve", signal: { kind: "chirp", amplitude: 2, start_frequency: { value: 5, unit: "Hz" }, end_frequency: { value: 50, unit: "Hz" }, duration: 2 } },
  });
  expect(requestOf({ ...fields, output: "" }, "bench")).not.toHaveProperty("drive");
});

it("tells what is wrong with a drive at its own field", () => {
  const of = (pointer: string) => driveFaults(new Problem({ title: "", status: 422, detail: "", errors: [{ pointer, detail: "wrong" }] }));
  expect(of("/drive/signal/start_frequency")).toEqual({ frequency: "wrong" });
  expect(of("/drive/signal/end_frequency")).toEqual({ end: "wrong" });
  expect(of("/drive/output")).toEqual({ output: "wrong" });
  expect([of("/drive"), of("/drive/signal/amplitude")]).toEqual([{ amplitude: "wrong" }, { amplitude: "wrong" }]);
  expect([of("/driver"), driveFaults(null)]).toEqual([{}, {}]);
});
