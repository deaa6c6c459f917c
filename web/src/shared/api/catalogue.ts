import { queryOptions } from "@tanstack/react-query";
import { api, must } from "./client";
import type { ElementEntry, MethodEntry, MetricEntry } from "./types";

const FOREVER = { staleTime: Infinity, gcTime: Infinity };

/** Every kind of block, by its kind. */
export const elementsQuery = queryOptions({
  queryKey: ["catalogue", "elements"],
  ...FOREVER,
  queryFn: async () => new Map<string, ElementEntry>((await must(api.GET("/v1/catalog/elements"))).items.map((entry) => [entry.kind, entry])),
});

export const metricsQuery = queryOptions({
  queryKey: ["catalogue", "metrics"],
  ...FOREVER,
  queryFn: async () => new Map<string, MetricEntry>((await must(api.GET("/v1/catalog/metrics"))).items.map((entry) => [entry.kind, entry])),
});

export const methodsQuery = queryOptions({
  queryKey: ["catalogue", "methods"],
  ...FOREVER,
  queryFn: async () => (await must(api.GET("/v1/catalog/methods"))).items as MethodEntry[],
});
