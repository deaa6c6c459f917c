import { queryOptions } from "@tanstack/react-query";
import { must } from "@/shared/api/client";
import type { Schemas } from "./schema";

/** The contract of the service that runs, from itself: forms know what it knows. */
export const contractQuery = queryOptions({
  queryKey: ["contract"],
  staleTime: Infinity,
  gcTime: Infinity,
  queryFn: async (): Promise<Schemas> => {
    const response = await fetch("/openapi.json");
    const found = await must<{ components: { schemas: Schemas } }>(Promise.resolve({ response, ...(response.ok ? { data: await response.json() } : { error: await response.text() }) }));
    return found.components.schemas;
  },
});
