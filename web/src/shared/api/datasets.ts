import { queryOptions } from "@tanstack/react-query";
import { api, must } from "./client";

/** Recordings that can be chosen. */
export const readyDatasets = queryOptions({
  queryKey: ["datasets", "choice"],
  queryFn: async () => (await must(api.GET("/v1/datasets", { params: { query: { limit: 100 } } }))).items.filter((one) => one.status === "ready"),
});

/** One recording with its channels. */
export const datasetQuery = (id: string) => queryOptions({ queryKey: ["dataset", id], queryFn: () => must(api.GET("/v1/datasets/{identifier}", { params: { path: { identifier: id } } })) });
