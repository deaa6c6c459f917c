import { queryOptions, type QueryClient } from "@tanstack/react-query";
import type { TFunction } from "i18next";
import { api, must } from "@/shared/api/client";
import { jobQuery, resultQuery } from "@/shared/api/jobs";
import { Problem } from "@/shared/api/problem";
import { revisionQuery, systemQuery } from "@/shared/api/systems";
import type { SystemDocument } from "@/shared/api/types";
import { designText, type DesignRef } from "@/shared/systems/compared";
import { describedDocument } from "@/shared/systems/described";
import { loopsOf } from "@/shared/systems/loops";

export interface DesignParameter {
  value: number;
  unit: string;
}

/** A system at certain values: a revision as it stands, the best that a search has found, an identified model. */
export interface Design {
  /** As in the address. */
  id: string;
  /** Of its system. */
  name: string;
  /** What it is of that system: a revision, the optimum of a search, an identified model. */
  part: string;
  /** Its page. */
  to: string;
  document: SystemDocument;
  /** Values that differ from the document's. */
  values: Record<string, number>;
  inputs: string[];
  outputs: Map<string, string>;
  loops: string[];
  parameters: Map<string, DesignParameter>;
  nonlinear: boolean;
}

/** What a search was asked for and what it found, as far as it makes a design. */
interface Asked {
  system: string | SystemDocument;
  alternatives?: { name: string; system?: string | SystemDocument | null; add?: unknown; remove?: unknown }[] | null;
}
interface Found {
  best?: Record<string, number>;
  chosen?: string;
}

interface Identified {
  document?: SystemDocument | null;
  system?: { id: string; revision: number } | null;
  parameters: Record<string, { value: number }>;
}

/** What a reference of an address stands for; what it cannot stand for is a problem in words. */
export const designQuery = (ref: DesignRef, client: QueryClient, t: TFunction, language: string) =>
  queryOptions({
    queryKey: ["design", designText(ref), language],
    staleTime: Infinity,
    retry: false,
    queryFn: (): Promise<Design> => (ref.kind === "revision" ? ofRevision(ref, client, t) : ofJob(ref.id, client, t, language)),
  });

async function ofRevision(ref: DesignRef & { kind: "revision" }, client: QueryClient, t: TFunction): Promise<Design> {
  const document = await client.ensureQueryData(revisionQuery(ref.id, ref.revision));
  const names = { name: document.name || ref.id, part: t("system.revision", { number: ref.revision }) };
  return made({ id: designText(ref), ...names, to: `/systems/${ref.id}/revisions?to=${ref.revision}`, document, values: {} }, client);
}

async function ofJob(id: string, client: QueryClient, t: TFunction, language: string): Promise<Design> {
  const job = await client.fetchQuery(jobQuery(id));
  const at = new Date(job.finished_at ?? job.created_at).toLocaleString(language, { dateStyle: "medium", timeStyle: "short" });
  if (job.kind === "identification" && job.result !== null) return ofIdentification(id, client, t("compare.modelOf", { at }));
  if (job.kind !== "optimization" || job.result === null) throw refused(t("compare.noOptimum", { id, kind: t(`jobs.kinds.${job.kind}`, job.kind), status: t(`status.${job.status}`, job.status) }));
  const result = (await client.ensureQueryData(resultQuery(id))) as unknown as Found;
  const asked = (await must(api.GET("/v1/jobs/{identifier}/request", { params: { path: { identifier: id } } }))) as unknown as Asked;
  const chosen = asked.alternatives?.find(({ name }) => name === result.chosen);
  if (chosen && (chosen.add || chosen.remove)) throw refused(t("compare.changedStructure", { id, name: chosen.name }));
  const own = chosen?.system;
  const document = typeof own === "object" && own !== null ? own : typeof own === "string" ? (await client.fetchQuery(systemQuery(own))).document : job.system ? await client.ensureQueryData(revisionQuery(job.system.id, job.system.revision)) : (asked.system as SystemDocument);
  return made({ id, name: document.name || job.system?.id || id, part: t("compare.optimumOf", { at }), to: `/jobs/${id}`, document, values: result.best ?? {} }, client);
}

/** A model of a recording alone is a system of its own; else it is a revision at the values that were found. */
async function ofIdentification(id: string, client: QueryClient, part: string): Promise<Design> {
  const { document: own, system, parameters } = (await client.ensureQueryData(resultQuery(id))) as unknown as Identified;
  const asked = own || system ? null : ((await must(api.GET("/v1/jobs/{identifier}/request", { params: { path: { identifier: id } } }))) as unknown as Asked);
  const document = own ?? (system ? await client.ensureQueryData(revisionQuery(system.id, system.revision)) : (asked!.system as SystemDocument));
  const values = own ? {} : Object.fromEntries(Object.entries(parameters).map(([path, { value }]) => [path, value]));
  return made({ id, name: document.name || system?.id || id, part, to: `/jobs/${id}`, document, values }, client);
}

const refused = (detail: string) => new Problem({ status: 0, title: "", detail });

async function made(own: Pick<Design, "id" | "name" | "part" | "to" | "document" | "values">, client: QueryClient): Promise<Design> {
  const opened = await client.ensureQueryData(describedDocument(own.document));
  const known = new Set(opened.parameters.filter(({ bound }) => !bound).map(({ path }) => path));
  // A search may choose numbers of its commands, too: they are none of the system's.
  const values = Object.fromEntries(Object.entries(own.values).filter(([path]) => known.has(path)));
  return {
    ...own,
    values,
    inputs: opened.inputs,
    outputs: new Map(opened.outputs.map(({ name, unit }) => [name, unit])),
    loops: loopsOf(own.document),
    parameters: new Map(opened.parameters.map(({ path, value, unit }) => [path, { value: values[path] ?? value, unit }])),
    nonlinear: opened.nonlinear,
  };
}

/** What all designs have, in the order of the first. */
export function common(lists: readonly (readonly string[])[]): string[] {
  const [first = [], ...rest] = lists;
  return first.filter((one) => rest.every((other) => other.includes(one)));
}

/** Labels by which each design is told from the others; what all have in common is left out where it is `short`. */
export function labelsOf(designs: readonly Pick<Design, "name" | "part">[], short = false): string[] {
  const alike = short && designs.every(({ name }) => name === designs[0]!.name);
  const labels = designs.map(({ name, part }) => (alike ? part : `${name}, ${part}`));
  return labels.map((label, i) => {
    const before = labels.slice(0, i).filter((other) => other === label).length;
    return before === 0 ? label : `${label} (${before + 1})`;
  });
}
