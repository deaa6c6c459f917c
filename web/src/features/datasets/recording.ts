import { queryOptions } from "@tanstack/react-query";
import { api, must } from "@/shared/api/client";
import type { components } from "@/shared/api/schema";

export type Dataset = components["schemas"]["DatasetReply"];

/** A recording; asked for again until its file has been read. */
export const datasetQuery = (id: string) =>
  queryOptions<Dataset>({
    queryKey: ["dataset", id],
    refetchInterval: (query) => (query.state.data && ["open", "parsing"].includes(query.state.data.status) ? 1000 : false),
    queryFn: (): Promise<Dataset> => must(api.GET("/v1/datasets/{identifier}", { params: { path: { identifier: id } } })),
  });
