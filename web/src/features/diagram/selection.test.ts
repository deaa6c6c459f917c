import { describe, expect, it } from "vitest";
import { selectionAt, withSelection } from "./selection";

describe("a selection in the address", () => {
  it("is there again, beside what else the address says", () => {
    const query = withSelection(new URLSearchParams("in=drive&frames=1"), { names: ["gain", "out:y"], wire: null });
    expect(query.get("in")).toBe("drive");
    expect(selectionAt(query)).toEqual({ names: ["gain", "out:y"], wire: null });
    expect(selectionAt(withSelection(query, { names: [], wire: "plant.in" }))).toEqual({ names: [], wire: "plant.in" });
  });
  it("is no change where the address says so already, and stays short", () => {
    const query = new URLSearchParams("at=gain");
    expect(withSelection(query, { names: ["gain"], wire: null })).toBe(query);
    expect(withSelection(query, { names: Array.from({ length: 300 }, (_, i) => `b${i}`), wire: null }).toString()).toBe("");
  });
});
