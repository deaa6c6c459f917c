import { keepPreviousData, useQuery } from "@tanstack/react-query";
import { api, atOnce } from "@/shared/api/client";
import type { LiveParameter } from "@/shared/live/protocol";
import { locusOf, type Locus, type Pole } from "@/shared/responses/locus";
import { fromPosition, travelOf, type Scale } from "./scale";

/** Values of the parameter along its slider, each with all poles. */
const COUNT = 121;

interface Asked {
  system: string;
  revision: number;
  parameter: LiveParameter | undefined;
  scale: Scale | undefined;
  /** Of the other parameters, those that differ from the document's. */
  values: Record<string, number>;
  from: string | undefined;
  to: string | undefined;
}

/** The root locus of one parameter over the travel of its slider, in one request; asked for again when another parameter has another value. */
export function useLocus({ system, revision, parameter, scale, values, from, to }: Asked): { locus: Locus | null; error: Error | null } {
  const path = parameter?.path ?? "";
  const others = Object.fromEntries(Object.entries(values).filter(([other]) => other !== path));
  const travel = parameter ? travelOf(parameter, scale) : null;
  const steps = travel ? Array.from({ length: COUNT }, (_, i) => fromPosition(i / (COUNT - 1), travel)) : [];
  const found = useQuery({
    queryKey: ["locus", system, revision, path, steps, others, from, to],
    enabled: parameter !== undefined && from !== undefined && to !== undefined,
    staleTime: Infinity,
    retry: false,
    placeholderData: keepPreviousData,
    queryFn: async (): Promise<Locus> => {
      // Poles belong to the whole system, whichever path is looked at; two frequencies are the shortest response.
      const body = { system, from, to, frequencies: [1, 2], metrics: [], variants: steps.map((value) => ({ ...others, [path]: value })) };
      const { variants } = await atOnce(api.POST("/v1/frequency-responses", { body: body as never }));
      return locusOf(path, steps, variants.map(({ poles }) => poles as Pole[]));
    },
  });
  return { locus: parameter && found.data?.path === path ? found.data : null, error: found.error };
}
