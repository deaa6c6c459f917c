import { infiniteQueryOptions, queryOptions } from "@tanstack/react-query";
import { api, must } from "./client";
import type { JobReply } from "./types";

export const ENDED = new Set<string>(["succeeded", "failed", "cancelled"]);

export const jobsQuery = (filter: { kind?: string; status?: string; schedule?: string }) =>
  infiniteQueryOptions({
    queryKey: ["jobs", filter],
    initialPageParam: undefined as string | undefined,
    refetchInterval: 3000,
    queryFn: ({ pageParam }) => must(api.GET("/v1/jobs", { params: { query: { limit: 50, cursor: pageParam, ...(filter as { kind?: undefined }) } } })),
    getNextPageParam: (page) => page.next_cursor ?? undefined,
  });

/** Milliseconds after its end in which a cancelled search may still give what it has found. */
const GRACE = 60_000;

function mayHandOver({ status, kind, result, finished_at }: JobReply): boolean {
  return status === "cancelled" && result === null && (kind === "optimization" || kind === "identification") && finished_at !== null && Date.now() - Date.parse(finished_at) < GRACE;
}

export const jobQuery = (id: string) =>
  queryOptions<JobReply>({
    queryKey: ["job", id],
    // Events tell at once; this is for the case that none come, and for the best point that a cancelled search hands over after its end.
    refetchInterval: (query) => (query.state.data && (!ENDED.has(query.state.data.status) || mayHandOver(query.state.data)) ? 3000 : false),
    queryFn: (): Promise<JobReply> => must(api.GET("/v1/jobs/{identifier}", { params: { path: { identifier: id } } })),
  });

export const resultQuery = (id: string) =>
  queryOptions({
    queryKey: ["job", id, "result"],
    staleTime: Infinity,
    queryFn: () => must(api.GET("/v1/jobs/{identifier}/result", { params: { path: { identifier: id } } })),
  });
