import type { Frame } from "@/shared/live/protocol";
import type { Point, Zone } from "@/shared/plots/types";
import type { Margins } from "./margins";

/** A property that is to stay on one side of a bound, in SI. */
export interface PanelGoal {
  metric: string;
  bound: "upper" | "lower";
  value: number;
  /** Where it is not of the output that is looked at: the controller's, of an effort. */
  output?: string;
}

/** What can be wanted on a panel: the side of the bound, where it is drawn, a bound to begin with. */
export const WANTED: Record<string, { bound: PanelGoal["bound"]; plot: "step" | "bode" | "phase" | "nyquist" | "poles"; first: number; domain: "time" | "loop" | "path" | "system" }> = {
  overshoot: { bound: "upper", plot: "step", first: 0.1, domain: "time" },
  undershoot: { bound: "upper", plot: "step", first: 0.1, domain: "time" },
  rise_time: { bound: "upper", plot: "step", first: NaN, domain: "time" },
  response_time: { bound: "upper", plot: "step", first: NaN, domain: "time" },
  settling_time: { bound: "upper", plot: "step", first: NaN, domain: "time" },
  peak: { bound: "upper", plot: "step", first: NaN, domain: "time" },
  control_effort: { bound: "upper", plot: "step", first: NaN, domain: "time" },
  bandwidth: { bound: "lower", plot: "bode", first: NaN, domain: "path" },
  phase_margin: { bound: "lower", plot: "phase", first: Math.PI / 4, domain: "loop" },
  gain_margin: { bound: "lower", plot: "bode", first: 2, domain: "loop" },
  sensitivity_peak: { bound: "upper", plot: "nyquist", first: 2, domain: "loop" },
  damping_ratio: { bound: "lower", plot: "poles", first: 0.5, domain: "system" },
};

export function readGoal(text: string): PanelGoal[] {
  const found = /^([a-z_]+)([<>])(.+)$/.exec(text);
  const value = Number(found?.[3]);
  return found && found[1]! in WANTED && Number.isFinite(value) ? [{ metric: found[1]!, bound: found[2] === "<" ? "upper" : "lower", value }] : [];
}

export function writeGoal({ metric, bound, value }: PanelGoal): string {
  return `${metric}${bound === "upper" ? "<" : ">"}${Number(value.toPrecision(6))}`;
}

/** What goals compare: of margins the distance from instability, in either direction. */
function compared(metric: string, value: number): number {
  if (metric === "gain_margin") return Math.max(value, 1 / value);
  return metric === "phase_margin" ? Math.abs(value) : value;
}

export function holds(goal: PanelGoal, shown: number | null | undefined): boolean | null {
  if (shown == null) return null;
  const value = compared(goal.metric, shown);
  return goal.bound === "upper" ? value <= goal.value * (1 + 1e-9) : value >= goal.value * (1 - 1e-9);
}

/** What the zones are placed by: the moving curve. */
export interface Facts {
  time: Float32Array;
  start: number;
  final: number;
  /** When the curve has gone a tenth of its way. */
  tenth: number;
  margins: Margins | null;
  /** Gain at low frequency, dB. */
  statically: number;
  /** Distance of the poles from the origin that the pole map is wide enough for. */
  reach: number;
}

export function factsOf(frame: Frame, output: number, margins: Margins | null, magnitude: Float32Array | null): Facts {
  const curve = output >= 0 ? frame.outputs(0, output) : new Float32Array(0);
  const start = curve[0] ?? 0;
  const final = curve[curve.length - 1] ?? NaN;
  let k = 0;
  while (k < curve.length && Math.abs(curve[k]! - start) < 0.1 * Math.abs(final - start)) k++;
  const { re, im } = frame.poles(0);
  let reach = 0;
  for (let i = 0; i < re.length; i++) if (Number.isFinite(re[i]!)) reach = Math.max(reach, Math.hypot(re[i]!, im[i]!));
  return { time: frame.time, start, final, tenth: frame.time[k] ?? 0, margins, statically: magnitude?.[0] ?? NaN, reach };
}

const FAR = Infinity;
/** Of the settled band, in parts of the way: as the metrics define them. */
const TOLERANCE: Record<string, number> = { settling_time: 0.02, response_time: 0.05 };
/** How far a margin's zone reaches to both sides of the frequency where it is read. */
const BESIDE = 1.35;

/** Where no curve should come, for one goal; null where the curve does not tell. */
export function zoneOf(goal: PanelGoal, facts: Facts, label: string, text: string): Zone | null {
  const { start, final, time, margins } = facts;
  const way = final - start;
  const end = time[time.length - 1] ?? 1;
  const zone = (shapes: Zone["shapes"], at: Point, axis: "x" | "y" | "both"): Zone => ({ id: goal.metric, shapes, handle: { at, axis, label, text } });
  const beyond = (edge: number, upwards: boolean): Zone["shapes"] => [{ kind: "box", x: [-FAR, FAR], y: upwards ? [edge, FAR] : [-FAR, edge] }];
  const beside = (frequency: number): [number, number] => [frequency / BESIDE, frequency * BESIDE];
  switch (goal.metric) {
    case "overshoot": {
      if (!Number.isFinite(way) || way === 0) return null;
      const edge = final + goal.value * way;
      return zone(beyond(edge, way > 0), [0.85 * end, edge], "y");
    }
    case "undershoot": {
      if (!Number.isFinite(way) || way === 0) return null;
      const edge = start - goal.value * way;
      return zone(beyond(edge, way < 0), [0.15 * end, edge], "y");
    }
    case "peak":
    case "control_effort":
      return zone([...beyond(goal.value, true), ...beyond(-goal.value, false)], [0.7 * end, goal.value], "y");
    case "rise_time": {
      if (!Number.isFinite(way) || way === 0) return null;
      const edge = start + 0.9 * way;
      return zone([{ kind: "box", x: [facts.tenth + goal.value, FAR], y: way > 0 ? [-FAR, edge] : [edge, FAR] }], [facts.tenth + goal.value, start + 0.45 * way], "x");
    }
    case "settling_time":
    case "response_time": {
      if (!Number.isFinite(way) || way === 0) return null;
      const half = TOLERANCE[goal.metric]! * Math.abs(way);
      return zone(
        [
          { kind: "box", x: [goal.value, FAR], y: [final + half, FAR] },
          { kind: "box", x: [goal.value, FAR], y: [-FAR, final - half] },
        ],
        [goal.value, final - 0.25 * way],
        "x",
      );
    }
    case "bandwidth": {
      const edge = facts.statically - 3;
      return Number.isFinite(edge) ? zone([{ kind: "box", x: [-FAR, goal.value], y: [-FAR, edge] }], [goal.value, edge], "x") : null;
    }
    case "phase_margin": {
      if (!margins?.phase) return null;
      const { frequency, turn } = margins.phase;
      const edge = turn + (goal.value * 180) / Math.PI;
      return zone([{ kind: "box", x: beside(frequency), y: [turn, edge] }], [frequency, edge], "y");
    }
    case "gain_margin": {
      if (!margins?.gain) return null;
      const edge = -20 * Math.log10(goal.value);
      return zone([{ kind: "box", x: beside(margins.gain.frequency), y: [edge, 0] }], [margins.gain.frequency, edge], "y");
    }
    case "sensitivity_peak":
      return zone([{ kind: "disc", center: [-1, 0], radius: 1 / goal.value }], [-1, 1 / goal.value], "y");
    case "damping_ratio": {
      const angle = Math.acos(Math.min(1, Math.max(0, goal.value)));
      const far = 0.6 * (facts.reach || 1);
      return zone([{ kind: "outside-wedge", angle }], [-far * Math.cos(angle), far * Math.sin(angle)], "both");
    }
    default:
      return null;
  }
}

/** The bound that belongs to a zone whose edge was taken to a point. */
export function boundAt(goal: PanelGoal, [x, y]: Point, { start, final, tenth, time, margins }: Facts): number {
  const way = final - start;
  const least = ((time[time.length - 1] ?? 1) - (time[0] ?? 0)) / 1000;
  switch (goal.metric) {
    case "overshoot":
      return Math.max(0, (y - final) / way);
    case "undershoot":
      return Math.max(0, (start - y) / way);
    case "peak":
    case "control_effort":
      return Math.max(1e-12, y);
    case "rise_time":
      return Math.max(least, x - tenth);
    case "settling_time":
    case "response_time":
      return Math.max(least, x);
    case "bandwidth":
      return Math.max(1e-12, x);
    case "phase_margin":
      return Math.min(Math.PI, Math.max(0.01, ((y - (margins?.phase?.turn ?? -180)) * Math.PI) / 180));
    case "gain_margin":
      return Math.max(1.01, 10 ** (-y / 20));
    case "sensitivity_peak":
      return Math.min(100, Math.max(1.01, 1 / Math.abs(y || 1e-9)));
    case "damping_ratio":
      return Math.min(0.999, Math.max(0.001, -x / (Math.hypot(x, y) || 1)));
    default:
      return goal.value;
  }
}
