import { expect, it } from "vitest";
import { BOX, pageOf, placed, type LineageNode } from "./graph";

it("goes from left to right, and keeps what belongs together side by side", () => {
  const nodes = ["ds_1", "ds_2", "job_1", "job_2", "sys_1@2"].map((id) => ({ id }));
  const edges = [{ from: "ds_2", to: "job_2" }, { from: "ds_1", to: "job_1" }, { from: "job_1", to: "sys_1@2" }, { from: "ds_1", to: "sys_1@2" }];
  const places = placed(nodes, edges);
  const columns = nodes.map(({ id }) => places.get(id)!.x / (BOX.width + BOX.across));
  expect(columns).toEqual([0, 0, 1, 1, 2]);
  expect(places.get("job_1")!.y).toBeLessThan(places.get("job_2")!.y);
  expect(new Set([...places.values()].map(({ x, y }) => `${x},${y}`)).size).toBe(5);
});

it("does not hang on a loop", () => expect(placed([{ id: "a" }, { id: "b" }], [{ from: "a", to: "b" }, { from: "b", to: "a" }]).size).toBe(2));

it("leads to the page of every node that is still there", () => {
  const node = (id: string, exists = true) => pageOf({ id, exists } as LineageNode);
  expect([node("ds_1"), node("sys_1@3"), node("job_1"), node("acq_1"), node("res_1"), node("ds_1", false)]).toEqual(["/datasets/ds_1", "/systems/sys_1/revisions?to=3", "/jobs/job_1", "/acquisitions/acq_1", "/results/res_1", null]);
});
