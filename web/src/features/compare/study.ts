import { queryOptions } from "@tanstack/react-query";
import { api, atOnce } from "@/shared/api/client";
import type { Metric, MetricEntry } from "@/shared/api/types";
import type { View } from "@/shared/responses/view";
import type { Design } from "./designs";

/** What is asked of every design: the view of the page with its gaps filled. */
export interface Question extends Pick<View, "amplitude" | "duration"> {
  input: string;
  output: string;
  /** The opened loop; null: the path from input to output. */
  loop: string | null;
  metrics: string[];
}

/** Metrics of one design, and how far its curves reach when nobody says so. */
export interface Measured {
  metrics: Record<string, Metric>;
  end: number;
  frequencies: [number, number] | null;
}

/** Curves of one design on the axes of all. */
export interface Drawn {
  verdict: string;
  outputs: Record<string, (number | null)[]>;
  re: (number | null)[];
  im: (number | null)[];
  poles: { real: number; imag: number }[];
}

export interface Axes {
  end: number;
  frequencies: number[];
}

type Domains = ReadonlyMap<string, Pick<MetricEntry, "domain">>;

/** Points of each curve, as on the front panel. */
export const SAMPLES = 1000;

function simulation(design: Design, question: Question): object {
  return { system: design.document, input: { port: question.input, signal: { kind: "step", amplitude: question.amplitude } }, variants: [design.values] };
}

function response(design: Design, { input, output, loop }: Question): object | null {
  if (loop !== null) return { system: design.document, variants: [design.values], open_at: loop };
  return design.outputs.has(output) ? { system: design.document, variants: [design.values], from: input, to: output } : null;
}

export const measuredQuery = (design: Design, question: Question, domains: Domains) =>
  queryOptions({
    queryKey: ["compare", "measured", design.id, question],
    staleTime: Infinity,
    retry: false,
    queryFn: async (): Promise<Measured> => {
      const of = (wanted: readonly string[]) => question.metrics.filter((name) => wanted.includes(domains.get(name)?.domain ?? ""));
      const body = response(design, question);
      const path = question.loop !== null && design.outputs.has(question.output);
      const [time, frequency] = await Promise.all([
        atOnce(api.POST("/v1/simulations", { body: { ...simulation(design, question), samples: 2, metrics: of(["time"]), ...(question.duration === null ? {} : { duration: question.duration }) } as never })),
        body && atOnce(api.POST("/v1/frequency-responses", { body: { ...body, ...(path ? { paths: [{ from: question.input, to: question.output }] } : {}), metrics: of(question.loop === null ? ["path", "system"] : ["loop", "path", "system"]) } as never })),
      ]);
      const [own, seen] = [time.variants[0]!, frequency?.variants[0]];
      // Metrics of a path do not apply to an opened loop: they are those of the path beside it.
      const beside = seen?.paths?.[0]?.metrics ?? {};
      const metrics = { ...own.metrics[question.output], ...seen?.metrics, ...Object.fromEntries(of(["path"]).flatMap((name) => (beside[name] ? [[name, beside[name]]] : []))) } as Record<string, Metric>;
      return { metrics, end: own.time.at(-1) ?? 0, frequencies: seen ? reach(seen.frequency) : null };
    },
  });

export const drawnQuery = (design: Design, question: Question, axes: Axes) =>
  queryOptions({
    queryKey: ["compare", "drawn", design.id, question.input, question.amplitude, question.output, question.loop, axes.end, axes.frequencies[0], axes.frequencies.at(-1)],
    staleTime: Infinity,
    retry: false,
    queryFn: async (): Promise<Drawn> => {
      const body = axes.frequencies.length > 0 ? response(design, question) : null;
      const [time, frequency] = await Promise.all([
        atOnce(api.POST("/v1/simulations", { body: { ...simulation(design, question), samples: SAMPLES, metrics: [], duration: axes.end } as never })),
        body && atOnce(api.POST("/v1/frequency-responses", { body: { ...body, frequencies: axes.frequencies, metrics: [] } as never })),
      ]);
      const [own, seen] = [time.variants[0]!, frequency?.variants[0]];
      return { verdict: own.verdict, outputs: own.outputs as Drawn["outputs"], re: seen?.real ?? [], im: seen?.imag ?? [], poles: (seen?.poles ?? []) as Drawn["poles"] };
    },
  });

/** First and last positive frequency of a list. */
function reach(frequency: readonly (number | null)[]): [number, number] | null {
  const positive = frequency.filter((w): w is number => w !== null && w > 0);
  return positive.length > 1 ? [positive[0]!, positive.at(-1)!] : null;
}

/** Axes on which all curves are drawn: the longest time, and every frequency that any of them shows. */
export function axesOf(measured: readonly Measured[], count = SAMPLES): Axes {
  const reaches = measured.flatMap(({ frequencies }) => (frequencies ? [frequencies] : []));
  const low = Math.min(...reaches.map(([from]) => from));
  const high = Math.max(...reaches.map(([, to]) => to));
  const frequencies = reaches.length === 0 ? [] : Array.from({ length: count }, (_, i) => (i === 0 ? low : i === count - 1 ? high : low * (high / low) ** (i / (count - 1))));
  return { end: Math.max(...measured.map(({ end }) => end)), frequencies };
}
