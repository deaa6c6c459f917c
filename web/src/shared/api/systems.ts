import { infiniteQueryOptions, keepPreviousData, queryOptions } from "@tanstack/react-query";
import { api, must, mustWithTag } from "./client";
import type { SystemDocument, WireSystem } from "./types";

export const systemsKey = ["systems"];

/** Systems, the newest first; those with a part of the name, or of an id. */
export const systemsQuery = (name = "") =>
  infiniteQueryOptions({
    queryKey: [...systemsKey, "listed", name],
    initialPageParam: undefined as string | undefined,
    queryFn: ({ pageParam }) => must(api.GET("/v1/systems", { params: { query: { limit: 100, cursor: pageParam, ...(name ? { name } : {}) } } })),
    getNextPageParam: (page) => page.next_cursor ?? undefined,
    placeholderData: keepPreviousData,
  });

/** Systems that can be chosen, the newest first. */
export const systemChoices = queryOptions({ queryKey: [...systemsKey, "choices"], queryFn: async () => (await must(api.GET("/v1/systems", { params: { query: { limit: 200 } } }))).items });

export const systemQuery = (id: string) =>
  queryOptions({
    queryKey: ["system", id],
    queryFn: async () => {
      const { data, etag } = await mustWithTag(api.GET("/v1/systems/{identifier}", { params: { path: { identifier: id } } }));
      return { ...data, etag, document: data.document as unknown as SystemDocument };
    },
  });

export const revisionsQuery = (id: string) =>
  queryOptions({
    queryKey: ["system", id, "revisions"],
    queryFn: () => must(api.GET("/v1/systems/{identifier}/revisions", { params: { path: { identifier: id }, query: { limit: 100 } } })),
  });

export const revisionQuery = (id: string, number: number) =>
  queryOptions({
    queryKey: ["system", id, "revision", number],
    staleTime: Infinity,
    queryFn: async () => (await must(api.GET("/v1/systems/{identifier}/revisions/{number}", { params: { path: { identifier: id, number } } }))).document as unknown as SystemDocument,
  });

export async function createSystem(document: SystemDocument): Promise<string> {
  return (await must(api.POST("/v1/systems", { body: document as unknown as WireSystem }))).id;
}

/** Appends a revision to the one that `etag` names, with the job whose values it takes; 412 when somebody else was faster. */
/** How long an answer to what is saved is waited for, ms: a connection may be lost without a word. */
const PATIENCE = 30_000;

export async function saveSystem(id: string, document: SystemDocument, etag: string, derivedFrom?: string) {
  return mustWithTag(
    api.PUT("/v1/systems/{identifier}", {
      params: { path: { identifier: id }, query: { derived_from: derivedFrom }, header: { "If-Match": etag } },
      body: document as unknown as WireSystem,
      signal: AbortSignal.timeout(PATIENCE),
    }),
  );
}

export async function deleteSystem(id: string, revision: number): Promise<void> {
  await must(api.DELETE("/v1/systems/{identifier}", { params: { path: { identifier: id }, header: { "If-Match": `"${revision}"` } } }));
}
