import { describe, expect, it } from "vitest";
import { cellsOf, columnsOf, guessLayout, rateOf } from "./preview";

describe("text files", () => {
  it("are understood with tabs, decimal commas and a header", () => {
    const lines = ["Recorded 2026", "Time [s]\tForce (kN)\tForce (kN)", "0,00\t1,5\t2", "0,01\t1,6\t3", "0,02\t1,7\t4"];
    const layout = guessLayout(lines);
    expect(layout).toEqual({ delimiter: "\t", decimal: ",", header_lines: 2 });
    expect(columnsOf(lines, layout).map((c) => [c.index, c.name, c.unit])).toEqual([[0, "time", "s"], [1, "force", "kN"], [2, "force_3", "kN"]]);
    expect(rateOf(lines, layout, 0)).toBe(100);
    expect(rateOf(lines, layout, 2)).toBe(1);
    expect(cellsOf(lines, layout, 1)).toEqual([["0,00", "1,5", "2"]]);
  });
  it("need no header", () => {
    const lines = ["1.0 2.0", "3.0 4.0"];
    const layout = guessLayout(lines);
    expect(layout).toEqual({ delimiter: " ", decimal: ".", header_lines: 0 });
    expect(columnsOf(lines, layout).map((c) => c.name)).toEqual(["channel_1", "channel_2"]);
  });
  it("have a rate only where time rises evenly", () => expect(rateOf(["0,1", "1,1", "5,1"], { delimiter: ",", decimal: ".", header_lines: 0 }, 0)).toBeNull());
});
