import { describe, expect, it } from "vitest";
import { bode, readFrame } from "./protocol";

function made(header: object, numbers: number[]): ArrayBuffer {
  let text = JSON.stringify(header);
  text += " ".repeat((4 - (text.length % 4)) % 4);
  const buffer = new ArrayBuffer(4 + text.length + 4 * numbers.length);
  new DataView(buffer).setUint32(0, text.length, true);
  new Uint8Array(buffer, 4, text.length).set(new TextEncoder().encode(text));
  new Float32Array(buffer, 4 + text.length).set(numbers);
  return buffer;
}

const arrays = [
  { name: "time", shape: [2] },
  { name: "outputs", shape: [2, 1, 2] },
  { name: "frequency", shape: [1] },
  { name: "response", shape: [2, 2, 1] },
  { name: "poles", shape: [2, 2, 0] },
];

describe("frames", () => {
  it("are read by variant and output", () => {
    const frame = readFrame(made({ seq: 3, variants: [{ verdict: "ok" }, { verdict: "unstable" }], arrays }, [0, 1, 10, 11, 20, 21, 5, 1, 2, 3, 4]));
    expect(frame.seq).toBe(3);
    expect([...frame.outputs(1, 0)]).toEqual([20, 21]);
    expect([...frame.response(1).im]).toEqual([4]);
    expect(frame.poles(0).re.length).toBe(0);
  });
  it("of another length are refused", () => expect(() => readFrame(made({ seq: 1, variants: [], arrays }, [0]))).toThrow(/bytes/));
});

describe("Bode diagrams", () => {
  it("follow the phase beyond half a turn", () => {
    // 1/s^3 turns by -270 degrees; a lag of order four passes -180.
    const s = [0.1, 1, 3, 10, 100];
    const points = s.map((w) => {
      const angle = -4 * Math.atan(w);
      const size = (1 + w * w) ** -2;
      return [size * Math.cos(angle), size * Math.sin(angle)];
    });
    const { phase, magnitude } = bode(Float32Array.from(points, (p) => p[0]!), Float32Array.from(points, (p) => p[1]!));
    s.forEach((w, i) => expect(phase[i]).toBeCloseTo((-4 * Math.atan(w) * 180) / Math.PI, 3));
    expect(magnitude[1]).toBeCloseTo(-40 * Math.log10(2), 4);
  });
  it("have no phase where nothing comes through, and begin behind it", () => {
    const { phase, magnitude } = bode(Float32Array.of(0, -1, -1), Float32Array.of(0, 1e-9, 1));
    expect([...phase]).toEqual([NaN, -180, -225]);
    expect(magnitude[0]).toBe(-Infinity);
  });
  it("see a double integrator at -180 degrees", () => expect(bode(Float32Array.of(-1), Float32Array.of(1e-9)).phase[0]).toBeCloseTo(-180));
});
