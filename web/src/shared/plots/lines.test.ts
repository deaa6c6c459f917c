import { describe, expect, it } from "vitest";
import { drawLine, drawPath, type Pen } from "./lines";

class Recorder implements Pen {
  readonly lines: [number, number][][] = [];
  moveTo(x: number, y: number) {
    this.lines.push([[x, y]]);
  }
  lineTo(x: number, y: number) {
    this.lines.at(-1)!.push([x, y]);
  }
  /** The height of the line at x, by interpolation between its corners. */
  at(x: number): number {
    for (const line of this.lines) {
      for (let i = 1; i < line.length; i++) {
        const [[x0, y0], [x1, y1]] = [line[i - 1]!, line[i]!];
        if (x >= x0 && x <= x1) return x1 === x0 ? y1 : y0 + ((y1 - y0) * (x - x0)) / (x1 - x0);
      }
    }
    return NaN;
  }
}

const grid = (count: number, width: number) => Array.from({ length: count }, (_, i) => (width * i) / (count - 1));

describe("a line", () => {
  const x = grid(1000, 460);
  const y = x.map((at) => 120 - 100 * (1 - Math.exp(-at / 50) * Math.cos(at / 15)));
  const drawn = new Recorder();
  drawLine(drawn, x, y, 0.15);
  it("passes every point within the tolerance", () => x.forEach((at, i) => expect(Math.abs(drawn.at(at) - y[i]!)).toBeLessThanOrEqual(0.15 + 1e-9)));
  it("has far fewer corners than points", () => expect(drawn.lines[0]!.length).toBeLessThan(150));
  it("begins and ends where its points do", () => {
    expect(drawn.lines[0]![0]).toEqual([x[0], y[0]]);
    expect(drawn.lines[0]!.at(-1)).toEqual([x.at(-1), y.at(-1)]);
  });
  it("keeps every corner of noise", () => {
    const noise = new Recorder();
    drawLine(noise, grid(100, 200), Array.from({ length: 100 }, (_, i) => (i % 2 === 0 ? 0 : 50)), 0.15);
    expect(noise.lines[0]!.length).toBe(100);
  });
  it("is interrupted where there is nothing", () => {
    const broken = new Recorder();
    drawLine(broken, [0, 1, 2, 3, 4, 5, 6], [NaN, 1, 1, NaN, 2, 2, 2], 0.15);
    expect(broken.lines).toEqual([[[1, 1], [2, 1]], [[4, 2], [6, 2]]]);
  });
  it("goes straight up where x stands still", () => {
    const jump = new Recorder();
    drawLine(jump, [0, 1, 1, 1, 2], [0, 0, 5, -5, 0], 0.15);
    expect(jump.lines).toEqual([[[0, 0], [1, 0], [1, 5], [1, -5], [2, 0]]]);
  });
});

it("a curve in the plane leaves out what lies on one spot, but not its end", () => {
  const drawn = new Recorder();
  drawPath(drawn, [0, 0.1, 0.2, 5, NaN, 7, 7.1], [0, 0.1, 0, 5, 0, 7, 7], 0.5);
  expect(drawn.lines).toEqual([[[0, 0], [5, 5]], [[7, 7], [7.1, 7]]]);
});
