import { useDebouncedValue } from "@mantine/hooks";
import { keepPreviousData, useQuery } from "@tanstack/react-query";
import { metricsQuery } from "@/shared/api/catalogue";
import { api, atOnce, must } from "@/shared/api/client";
import type { GoalResult } from "../results";
import { candidateOf, studiesOf, type Asked, type StudyVariant } from "./candidate";

/** Milliseconds for which a slider must rest until its candidate is computed. */
const REST = 150;

/** What a job was asked for. */
export function useAsked(job: string, wanted: boolean) {
  return useQuery({
    queryKey: ["job", job, "request"],
    enabled: wanted,
    staleTime: Infinity,
    queryFn: async () => (await must(api.GET("/v1/jobs/{identifier}/request", { params: { path: { identifier: job } } }))) as unknown as Asked,
  });
}

/** Curves and metrics at the values of a step or of a point of the front, computed by the service as they are looked at. */
export function useCandidate(job: string, goals: GoalResult[], values: Record<string, number> | null) {
  const rested = useDebouncedValue(values, REST)[0];
  const metrics = useQuery(metricsQuery);
  const asked = useAsked(job, values !== null);
  // Of several structures the request does not say which one these values belong to.
  const known = asked.data !== undefined && metrics.data !== undefined && !asked.data.alternatives?.length;
  const found = useQuery({
    queryKey: ["job", job, "candidate", rested],
    enabled: known && rested !== null && values !== null,
    staleTime: Infinity,
    retry: false,
    placeholderData: keepPreviousData,
    queryFn: async () => {
      const domains = metrics.data!;
      const replies = await Promise.all(
        studiesOf(asked.data!, goals, domains, rested!).map(async ({ key, kind, body }) => {
          const { variants } = kind === "simulation" ? await atOnce(api.POST("/v1/simulations", { body: body as never })) : await atOnce(api.POST("/v1/frequency-responses", { body: body as never }));
          return [key, variants as StudyVariant[]] as const;
        }),
      );
      return candidateOf(asked.data!, goals, domains, new Map(replies));
    },
  });
  return values === null ? { candidate: null, stale: false, error: null } : { candidate: found.data ?? null, stale: rested !== values || found.isFetching, error: asked.error ?? found.error };
}
