import { expect, it } from "vitest";
import { sizeOf, tornado } from "./table";

it("a tornado begins with the longest bar", () => expect(tornado([{ name: "a", value: 1 }, { name: "b", value: null }, { name: "c", value: -3 }])).toEqual([{ name: "c", value: -3 }, { name: "a", value: 1 }]));

it("colours see small influences", () => {
  expect(sizeOf(0.25, 1)).toBe(0.5);
  expect(sizeOf(Infinity, 1)).toBe(0);
});
