import { infiniteQueryOptions, queryOptions } from "@tanstack/react-query";
import { api, must } from "@/shared/api/client";
import type { components } from "@/shared/api/schema";

type Schemas = components["schemas"];
export type Acquisition = Schemas["AcquisitionReply"];
export type AcquisitionRequest = Schemas["AcquisitionRequest"];
export type AcquisitionStatus = Acquisition["status"];
export type AgentReply = Schemas["AgentReply"];
export type Finding = Schemas["RigFindingDocument"];
export type Template = Schemas["TemplateReply"] & { document: AcquisitionRequest };

export interface Calibration {
  certificate?: string;
  calibrated_on?: string;
  due?: string;
  laboratory?: string;
}
export interface RigInput {
  name: string;
  channel: string;
  kind: string;
  unit: string;
  quantity?: string;
  sensitivity: number;
  range: number;
  distance?: number;
  model?: string;
  serial?: string;
  calibration?: Calibration;
  /** From the sensor to the input. */
  chain?: { model: string; serial: string; gain: number; calibration?: Calibration }[];
}
export interface RigOutput {
  name: string;
  channel: string;
  kind: string;
  amplitude: number;
  slew: number | null;
  duration: number | null;
  safe: number;
  soft_start: number;
  soft_stop: number;
}
export interface RigDocument {
  devices?: { name: string; model: string; serial: string; simulated?: boolean }[];
  inputs?: RigInput[];
  outputs?: RigOutput[];
  daq?: string;
  findings?: Finding[];
  checked_at?: string | null;
  /** What of a measurement its agent knows beyond the first ones. */
  understands?: string[];
}
export type Rig = Schemas["RigReply"] & { document: RigDocument };

export const rigsQuery = queryOptions({
  queryKey: ["rigs"],
  refetchInterval: 5000,
  queryFn: async () => (await must(api.GET("/v1/rigs", { params: { query: { limit: 200 } } }))).items as Rig[],
});

export const rigQuery = (id: string) =>
  queryOptions({
    queryKey: ["rig", id],
    refetchInterval: 5000,
    queryFn: async () => (await must(api.GET("/v1/rigs/{identifier}", { params: { path: { identifier: id } } }))) as Rig,
  });

export const agentsQuery = queryOptions({
  queryKey: ["agents"],
  refetchInterval: 5000,
  queryFn: async () => (await must(api.GET("/v1/agents", { params: { query: { limit: 200 } } }))).items,
});

export const templatesQuery = queryOptions({
  queryKey: ["acquisition-templates"],
  queryFn: async () => (await must(api.GET("/v1/acquisition-templates", { params: { query: { limit: 200 } } }))).items as Template[],
});

export const acquisitionsQuery = (filter: { rig?: string; status?: AcquisitionStatus }) =>
  infiniteQueryOptions({
    queryKey: ["acquisitions", filter],
    initialPageParam: undefined as string | undefined,
    refetchInterval: 3000,
    queryFn: ({ pageParam }) => must(api.GET("/v1/acquisitions", { params: { query: { limit: 30, cursor: pageParam, ...filter } } })),
    getNextPageParam: (page) => page.next_cursor ?? undefined,
  });

const OVER = new Set<AcquisitionStatus>(["done", "failed", "lost", "cancelled"]);

/** Whether nothing more happens to a measurement by itself, the steps that follow it included. */
export function settled(found: Acquisition): boolean {
  return OVER.has(found.status) && (found.attempts.at(-1)?.then ?? []).every((step) => !["waiting", "running"].includes(step.status));
}

export const acquisitionQuery = (id: string) =>
  queryOptions<Acquisition>({
    queryKey: ["acquisition", id],
    refetchInterval: (query) => (query.state.data && !settled(query.state.data) ? 1500 : false),
    queryFn: (): Promise<Acquisition> => must(api.GET("/v1/acquisitions/{identifier}", { params: { path: { identifier: id } } })),
  });

/** What an agent is at, judged by the service's own clock: a rig may not move without a word from it for longer than a lease. */
export function presence(agent: AgentReply): "ready" | "waiting" | "away" {
  const silent = (Date.parse(agent.time) - Date.parse(agent.seen_at)) / 1000;
  return silent > agent.lease_seconds ? "away" : agent.has_rig ? "ready" : "waiting";
}

/** How a calibration stands on a day: none stated, valid, due within a month, overdue. */
export function calibrationState(calibration: Calibration | undefined, today: string): "none" | "valid" | "soon" | "overdue" {
  if (!calibration?.due) return "none";
  if (calibration.due < today) return "overdue";
  const month = new Date(Date.parse(today) + 30 * 86_400_000).toISOString().slice(0, 10);
  return calibration.due <= month ? "soon" : "valid";
}
