import type { Opened } from "@/shared/live/protocol";

/** A recorded channel over the curve of an output. */
export interface Overlay {
  output: string;
  dataset: string;
  channel: string;
  start: number;
  relative: boolean;
}

/** What is commanded, looked at and drawn; all of it stands in the address of its page. */
export interface View {
  input: string | null;
  amplitude: number;
  /** The output whose metrics are shown. */
  output: string | null;
  loop: string | null;
  path: [string, string] | null;
  /** Seconds; null lets the service choose. */
  duration: number | null;
  /** Plots in their order: `step:position`, `bode`, `phase`, `nyquist`, `nichols`, `poles`, `spectrum:position`. */
  plots: string[] | null;
  measured: Overlay[];
}

/** Metrics that need nothing but the curves. The first are shown until somebody chooses. */
const USUAL = ["rise_time", "response_time", "settling_time", "overshoot", "peak", "steady_state_error", "bandwidth", "phase_margin", "gain_margin", "sensitivity_peak", "damping_ratio"];

/** What follows no reference has no error: its output is another quantity than its input. */
export function usualMetrics(loops: readonly string[]): string[] {
  return loops.length > 0 ? USUAL : USUAL.filter((name) => name !== "steady_state_error");
}
export const MEASURABLE = [...USUAL, "peak_time", "undershoot", "delay_margin", "complementary_peak", "critical_frequency", "iae", "ise", "itae", "control_effort", "max_velocity", "max_acceleration"];

export const VIEW_KEYS = ["in", "amp", "out", "loop", "path", "T", "v", "ds"] as const;
/** Between the parts of an overlay or a snapshot in the address. */
export const PART = "~";

/** A list in an address, written with commas. */
export function listIn(query: URLSearchParams, key: string): string[] | null {
  return query.get(key)?.split(",").filter(Boolean) ?? null;
}

export function readView(query: URLSearchParams): View {
  const pair = listIn(query, "path");
  const duration = Number(query.get("T"));
  const amplitude = Number(query.get("amp") ?? 1);
  return {
    input: query.get("in"),
    amplitude: Number.isFinite(amplitude) && amplitude !== 0 ? amplitude : 1,
    output: query.get("out"),
    loop: query.get("loop"),
    path: pair?.length === 2 ? [pair[0]!, pair[1]!] : null,
    duration: Number.isFinite(duration) && duration > 0 ? duration : null,
    plots: listIn(query, "v"),
    measured: query.getAll("ds").flatMap(readOverlay),
  };
}

/** Writes a view into an address, in which none of its keys stands. */
export function writeView(view: View, query: URLSearchParams): void {
  const put = (key: (typeof VIEW_KEYS)[number], value: string | number | null | undefined) => {
    if (value !== null && value !== undefined && value !== "") query.set(key, String(value));
  };
  put("in", view.input);
  if (view.amplitude !== 1) put("amp", view.amplitude);
  put("out", view.output);
  put("loop", view.loop);
  if (view.path) put("path", view.path.join(","));
  put("T", view.duration);
  put("v", view.plots?.join(","));
  for (const { output, dataset, channel, start, relative } of view.measured) query.append("ds", [output, dataset, channel, start, relative ? 1 : 0].join(PART));
}

function readOverlay(text: string): Overlay[] {
  const [output, dataset, channel, start, relative] = text.split(PART);
  return output && dataset && channel && Number.isFinite(Number(start)) ? [{ output, dataset, channel, start: Number(start), relative: relative === "1" }] : [];
}

export function mainOutput(view: Pick<View, "output">, opened: Pick<Opened, "outputs">): string {
  return opened.outputs.find((o) => o.name === view.output)?.name ?? opened.outputs[0]?.name ?? "";
}

/** The plots of a page that nobody has arranged. */
export function firstPlots(curves: string[], output: string, loop: boolean): string[] {
  const others = curves.filter((name) => name !== output).slice(0, loop ? 1 : 2);
  return [`step:${output}`, ...others.map((name) => `step:${name}`), "bode", "phase", ...(loop ? ["nyquist"] : []), "poles"];
}
