import { infiniteQueryOptions, queryOptions } from "@tanstack/react-query";
import { api, must, mustWithTag } from "./client";
import type { components } from "./schema";

type Schemas = components["schemas"];
export type ScheduleRequest = Schemas["ScheduleRequest"];
export type ScheduleReply = Schemas["ScheduleReply"];
/** What a schedule runs, as the service takes it. */
export type ScheduledJob = ScheduleRequest["job"];

export const schedulesQuery = infiniteQueryOptions({
  queryKey: ["schedules"],
  initialPageParam: undefined as string | undefined,
  refetchInterval: 15_000,
  queryFn: ({ pageParam }) => must(api.GET("/v1/schedules", { params: { query: { limit: 100, cursor: pageParam } } })),
  getNextPageParam: (page) => page.next_cursor ?? undefined,
});

export const scheduleQuery = (id: string) =>
  queryOptions({
    queryKey: ["schedule", id],
    refetchInterval: 15_000,
    queryFn: async () => {
      const { data, etag } = await mustWithTag(api.GET("/v1/schedules/{identifier}", { params: { path: { identifier: id } } }));
      return { ...data, etag, document: data.document as unknown as ScheduleRequest };
    },
  });

export const runsQuery = (id: string) =>
  queryOptions({
    queryKey: ["schedule", id, "runs"],
    refetchInterval: 5000,
    queryFn: () => must(api.GET("/v1/schedules/{identifier}/runs", { params: { path: { identifier: id }, query: { limit: 50 } } })),
  });

/** The address of the form that makes a schedule of a request, which every page with such a request can lead to. */
export function scheduleAt(name: string, job: object): string {
  return `/schedules/new?${new URLSearchParams({ name, job: JSON.stringify(job) }).toString()}`;
}
