import { expect, it } from "vitest";
import { given, readMatch, writeMatch } from "./address";
import { likely } from "./sources";

it("keeps what is matched in the address, and what else is there", () => {
  const match = { system: "sys_1", dataset: "ds_1", inputs: { u: "valve" }, outputs: { y: "position", x: "" } };
  const query = writeMatch(new URLSearchParams("p=k,tau&in.old=gone"), match);
  expect(query.get("p")).toBe("k,tau");
  expect(query.has("in.old")).toBe(false);
  expect(readMatch(query)).toEqual({ ...match, outputs: { y: "position" } });
});

it("asks only for what has a channel", () => expect(given({ y: "position", x: "" })).toEqual({ y: "position" }));

it("takes names that agree for the same", () => {
  const channels = [{ name: "Motor_Speed", unit: "rad/s" }];
  expect([likely("motor speed", channels), likely("force", channels)]).toEqual(["Motor_Speed", ""]);
});
