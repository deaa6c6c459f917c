import { keepPreviousData, useQuery } from "@tanstack/react-query";
import { api, atOnce } from "@/shared/api/client";
import type { LiveParameter } from "@/shared/live/protocol";
import type { Family } from "@/shared/responses/pull";
import { fromPosition, travelOf, type Scale } from "./scale";

/** Values of the parameter along its slider, and frequencies of each response. */
const [VALUES, FREQUENCIES] = [41, 61];
/** One value in so many is asked for first: a curve can be taken hold of in a tenth of the time, and its way becomes exact while it is held. */
const FIRST = 10;

interface Asked {
  system: string;
  revision: number;
  parameter: LiveParameter | undefined;
  scale: Scale | undefined;
  /** Of the other parameters, those that differ from the document's. */
  values: Record<string, number>;
  /** The loop that is opened, or from where to where. */
  shown: { open_at: string } | { from: string; to: string } | undefined;
  /** Of the frequencies that are drawn, rad/s. */
  range: [number, number] | null;
}

/** What a curve does when it is pulled: its responses over the travel of a slider, first at few values; asked for again when another parameter has another value. */
export function usePull({ system, revision, parameter, scale, values, shown, range }: Asked): { family: Family | null; error: Error | null } {
  const path = parameter?.path ?? "";
  const others = Object.fromEntries(Object.entries(values).filter(([other]) => other !== path));
  const travel = parameter ? travelOf(parameter, scale) : null;
  const steps = travel ? Array.from({ length: VALUES }, (_, i) => fromPosition(i / (VALUES - 1), travel)) : [];
  const over = (taken: number[]) => ({
    queryKey: ["pull", system, revision, path, taken, others, shown, range],
    staleTime: Infinity,
    retry: false,
    placeholderData: keepPreviousData,
    queryFn: async (): Promise<Family> => {
      const [low, high] = range!;
      const frequency = Array.from({ length: FREQUENCIES }, (_, i) => low * (high / low) ** (i / (FREQUENCIES - 1)));
      const body = { system, ...shown, frequencies: frequency, metrics: [], variants: taken.map((value) => ({ ...others, [path]: value })) };
      const { variants } = await atOnce(api.POST("/v1/frequency-responses", { body: body as never }));
      const numbers = (list: readonly (number | null)[]) => Float64Array.from(list, (value) => value ?? NaN);
      return { path, values: taken, frequency, responses: variants.map(({ real, imag }) => ({ re: numbers(real), im: numbers(imag) })) };
    },
  });
  const few = useQuery({ ...over(steps.filter((_, i) => i % FIRST === 0)), enabled: parameter !== undefined && shown !== undefined && range !== null });
  const all = useQuery({ ...over(steps), enabled: few.isSuccess && !few.isPlaceholderData });
  const { data } = all.isPlaceholderData && !few.isPlaceholderData ? few : all.data ? all : few;
  return { family: parameter && data?.path === path ? data : null, error: few.error ?? all.error };
}
