import { queryOptions } from "@tanstack/react-query";
import { api, atOnce, must } from "@/shared/api/client";
import type { Metric } from "@/shared/api/types";
import type { Overlay } from "@/shared/responses/view";

/** What a curve tells by itself: neither its command nor its loop is known. */
const OF_A_CURVE = new Set(["rise_time", "response_time", "settling_time", "peak_time", "overshoot", "undershoot", "peak"]);
/** Samples of which metrics are taken: seconds of computing. */
const MOST_SAMPLES = 5000;

type Values = (number | null)[];

/** A recorded curve as the command of a system that passes it on: the engine then measures it as it measures every curve, in straight lines between its samples. */
export function asCommand(time: Values, values: Values, { output, start, relative }: Pick<Overlay, "output" | "start" | "relative">): object | null {
  const points = time.flatMap((at, i): [number, number][] => (at === null || values[i] == null ? [] : [[at - start, values[i]]])).filter(([at]) => at >= 0);
  if (points.length < 2) return null;
  const zero = relative ? points[0]![1] : 0;
  return {
    system: { blocks: { recorded: { kind: "input" } }, outputs: { [output]: "recorded" } },
    input: { port: "recorded", signal: { kind: "sampled", time: points.map(([at]) => at), values: points.map(([, value]) => value - zero) } },
    samples: 2,
    duration: points.at(-1)![0],
  };
}

/** The metrics of a recording over the stretch that is drawn; none of one that has too many samples there. */
export const recordedQuery = (overlay: Overlay, end: number, wanted: readonly string[]) =>
  queryOptions({
    queryKey: ["compare", "metrics of", overlay, end, wanted],
    staleTime: Infinity,
    retry: false,
    queryFn: async (): Promise<Record<string, Metric>> => {
      const { dataset, channel, start, output } = overlay;
      const seen = await must(api.GET("/v1/datasets/{identifier}/channels/{name}", { params: { path: { identifier: dataset, name: channel }, query: { start, end: start + end, points: MOST_SAMPLES } } }));
      const body = seen.values ? asCommand(seen.time, seen.values, overlay) : null;
      if (body === null) return {};
      const reply = await atOnce(api.POST("/v1/simulations", { body: { ...body, metrics: wanted.filter((name) => OF_A_CURVE.has(name)) } as never }));
      // A command has no unit, and what has the unit of the curve is in the recording's.
      const metrics = (reply.variants[0]!.metrics[output] ?? {}) as Record<string, Metric>;
      return Object.fromEntries(Object.entries(metrics).map(([name, metric]) => [name, name === "peak" ? { ...metric, unit: seen.unit } : metric]));
    },
  });
