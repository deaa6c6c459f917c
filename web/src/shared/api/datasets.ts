import { infiniteQueryOptions, keepPreviousData, queryOptions } from "@tanstack/react-query";
import { api, must } from "./client";
import type { components } from "./schema";

export type Dataset = components["schemas"]["DatasetReply"];

/** Recordings, the newest first; those with a part of the name, or of an id, or in one state. */
export const datasetsQuery = (filter: { name?: string; status?: Dataset["status"] }) =>
  infiniteQueryOptions({
    queryKey: ["datasets", "listed", filter],
    initialPageParam: undefined as string | undefined,
    queryFn: ({ pageParam }) => must(api.GET("/v1/datasets", { params: { query: { limit: 100, cursor: pageParam, ...filter, name: filter.name || undefined } } })),
    getNextPageParam: (page) => page.next_cursor ?? undefined,
    placeholderData: keepPreviousData,
  });

/** Recordings that can be chosen, the newest first. */
export const readyDatasets = queryOptions({
  queryKey: ["datasets", "choices"],
  queryFn: async () => (await must(api.GET("/v1/datasets", { params: { query: { limit: 200, status: "ready" } } }))).items,
});

/** A recording with its channels; asked for again until its file has been read. */
export const datasetQuery = (id: string) =>
  queryOptions<Dataset>({
    queryKey: ["dataset", id],
    refetchInterval: (query) => (query.state.data && ["open", "parsing"].includes(query.state.data.status) ? 1000 : false),
    queryFn: (): Promise<Dataset> => must(api.GET("/v1/datasets/{identifier}", { params: { path: { identifier: id } } })),
  });
