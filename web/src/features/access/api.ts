import { queryOptions } from "@tanstack/react-query";
import { api, must, mustWithTag } from "@/shared/api/client";
import type { components } from "@/shared/api/schema";

type Schemas = components["schemas"];
export type Key = Schemas["KeyReply"];
export type NewKey = Schemas["NewKeyReply"];
export type WorkspaceHead = Schemas["WorkspaceHead"];
export type Workspace = Schemas["WorkspaceReply"];
export type Limits = Schemas["LimitsDocument"];

export const SCOPES = ["read", "write", "run", "acquire", "admin"] as const;
export type Scope = (typeof SCOPES)[number];

/** What is counted for a workspace, in the order in which it is shown. */
export const COUNTED = ["systems", "stored_bytes", "jobs", "running_jobs", "schedules", "webhooks"] as const;
export type Counted = (typeof COUNTED)[number];

export const keysQuery = queryOptions({ queryKey: ["keys"], retry: false, queryFn: async () => (await must(api.GET("/v1/keys", { params: { query: { limit: 500 } } }))).items });

export const workspacesQuery = queryOptions({ queryKey: ["workspaces"], retry: false, queryFn: async () => (await must(api.GET("/v1/workspaces", { params: { query: { limit: 500 } } }))).items });

export const workspaceQuery = (id: string) =>
  queryOptions({
    queryKey: ["workspaces", id],
    queryFn: async () => {
      const { data, etag } = await mustWithTag(api.GET("/v1/workspaces/{identifier}", { params: { path: { identifier: id } } }));
      return { ...data, etag };
    },
  });
