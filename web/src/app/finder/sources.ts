import { queryOptions, type QueryClient } from "@tanstack/react-query";
import type { TFunction } from "i18next";
import { api, must } from "@/shared/api/client";
import type { Comment } from "@/shared/api/comments";
import { Problem } from "@/shared/api/problem";
import { words } from "@/shared/units/format";
import type { Entry, Kind } from "./match";

/** Of each list, the newest; more than that is told. */
const MOST = 5000;
const PAGE = 1000;

interface Page<Item> {
  items: Item[];
  next_cursor?: string | null;
}

/** What there is of one kind; `cut` when there is more than is looked through. */
export interface Source {
  entries: Entry[];
  cut?: boolean;
}

async function all<Item>(page: (query: { limit: number; cursor?: string }) => Promise<Page<Item>>): Promise<{ items: Item[]; cut: boolean }> {
  const items: Item[] = [];
  for (let cursor: string | null | undefined; items.length < MOST; ) {
    const got = await page({ limit: PAGE, ...(cursor ? { cursor } : {}) });
    items.push(...got.items);
    cursor = got.next_cursor;
    if (!cursor) return { items, cut: false };
  }
  return { items, cut: true };
}

const day = (at: string) => at.slice(0, 10);

/** Asked for once, though jobs are called by their systems, too. */
const systemsOf = (client: QueryClient) => client.fetchQuery({ queryKey: ["finder", "heads"], staleTime: 10_000, retry: false, queryFn: () => all((query) => must(api.GET("/v1/systems", { params: { query } }))) });

/** Jobs and optima: they are called by what they do and by their system. */
async function ofJobs(t: TFunction, client: QueryClient): Promise<Source> {
  const [jobs, systems] = await Promise.all([all((query) => must(api.GET("/v1/jobs", { params: { query } }))), systemsOf(client)]);
  const names = new Map(systems.items.map(({ id, name }) => [id, name]));
  return {
    cut: jobs.cut,
    entries: jobs.items.map((job): Entry => {
      const of = job.system ? names.get(job.system.id) || job.system.id : "";
      const title = t(`jobs.kinds.${job.kind}`, words(job.kind));
      return { kind: job.kind === "optimization" && job.result ? "optima" : "jobs", title: of ? `${title}: ${of}` : title, about: `${t(`status.${job.status}`, job.status)} · ${day(job.created_at)}`, words: job.id, to: `/jobs/${job.id}` };
    }),
  };
}

/** Letters of a comment that stand in the list. */
const SHOWN = 90;

/** A comment leads to what it is about. */
export function commentEntry({ id, about, text, author, created_at }: Comment): Entry[] {
  const place = { sys: `/systems/${about}`, ds: `/datasets/${about}`, job: `/jobs/${about}`, res: `/results/${about}` }[about.split("_")[0]!];
  const line = text.replace(/\s+/g, " ").trim();
  return place === undefined ? [] : [{ kind: "comments", title: line.length > SHOWN ? `${line.slice(0, SHOWN - 1)}…` : line, about: `${author} · ${day(created_at)}`, words: `${line} ${id} ${about}`, to: place }];
}

/** Kinds of results that are asked for and kept. */
const STUDIES = new Set(["frf", "spectrum", "simulation", "frequency_response", "influence"]);

const PAGES: [to: string, key: string][] = [
  ["/systems", "nav.systems"],
  ["/datasets", "nav.datasets"],
  ["/jobs", "nav.jobs"],
  ["/schedules", "nav.schedules"],
  ["/rigs", "nav.rigs"],
  ["/access", "nav.access"],
  ["/about", "nav.about"],
  ["/systems#templates", "systems.templates"],
  ["/compare", "compare.title"],
  ["/identify", "matching.identify"],
  ["/validate", "matching.validate"],
  ["/schedules/new", "schedules.new"],
];

/** The text of a piece of HTML, which is parsed only: nothing of it is put on a page. `between` stands before each mark. */
function bare(html: string, between = ""): string {
  const text = new DOMParser().parseFromString(html.replaceAll("<", `${between}<`), "text/html").body.textContent ?? "";
  return text.replace(/\s+/g, " ").trim();
}

interface SearchIndex {
  items: { location: string; title: string; text: string; path?: string[] }[];
}

/** Chapters of the documentation, as its own search knows them. */
export function chapters({ items }: SearchIndex): Entry[] {
  return items.map(({ location, title, text, path }) => ({ kind: "documentation", title: bare(title), about: (path ?? []).map((part) => bare(part)).join(" › "), words: bare(text, " "), to: `/docs/${location}`, outside: true }));
}

async function ofDocumentation(): Promise<Source> {
  const reply = await fetch("/docs/search.json");
  if (!reply.ok) throw new Problem({ status: reply.status, title: "", detail: reply.statusText });
  return { entries: [{ kind: "documentation", title: "API", about: "OpenAPI", to: "/docs/api", outside: true }, ...chapters((await reply.json()) as SearchIndex)] };
}

const read: Partial<Record<Kind, (t: TFunction, client: QueryClient) => Promise<Source>>> = {
  pages: async (t) => ({ entries: PAGES.map(([to, key]) => ({ kind: "pages", title: t(key), about: "", to })) }),
  systems: async (t, client) => {
    const { items, cut } = await systemsOf(client);
    return { cut, entries: items.map(({ id, name, revision }) => ({ kind: "systems", title: name || id, about: t("system.revision", { number: revision }), words: id, to: `/systems/${id}` })) };
  },
  jobs: ofJobs,
  datasets: async (t) => {
    const { items, cut } = await all((query) => must(api.GET("/v1/datasets", { params: { query } })));
    return { cut, entries: items.map(({ id, name, status, format, created_at }) => ({ kind: "datasets", title: name || id, about: [t(`status.${status}`, status), format, day(created_at)].filter(Boolean).join(" · "), words: id, to: `/datasets/${id}` })) };
  },
  results: async (t, client) => {
    const [{ items, cut }, systems] = await Promise.all([all((query) => must(api.GET("/v1/results", { params: { query } }))), systemsOf(client)]);
    const names = new Map(systems.items.map(({ id, name }) => [id, name]));
    // What a job has found is found as that job.
    const kept = items.filter(({ kind }) => STUDIES.has(kind));
    return { cut, entries: kept.map(({ id, kind, system, created_at }) => ({ kind: "results", title: [t(`jobs.kinds.${kind}`, words(kind)), system && (names.get(system.id) || system.id)].filter(Boolean).join(": "), about: day(created_at), words: id, to: `/results/${id}` })) };
  },
  schedules: async (t) => {
    const { items, cut } = await all((query) => must(api.GET("/v1/schedules", { params: { query } })));
    return { cut, entries: items.map(({ id, name, kind, cron }) => ({ kind: "schedules", title: name || id, about: `${t(`jobs.kinds.${kind}`, words(kind))} · ${cron}`, words: id, to: `/schedules/${id}` })) };
  },
  rigs: async () => {
    const { items, cut } = await all((query) => must(api.GET("/v1/rigs", { params: { query } })));
    return { cut, entries: items.map(({ id, name }) => ({ kind: "rigs", title: name || id, about: "", words: id, to: `/rigs/${id}` })) };
  },
  acquisitions: async (t) => {
    const { items, cut } = await all((query) => must(api.GET("/v1/acquisitions", { params: { query } })));
    return { cut, entries: items.map(({ id, name, rig, status }) => ({ kind: "acquisitions", title: name || id, about: `${rig} · ${t(`status.${status}`, status)}`, words: id, to: `/acquisitions/${id}` })) };
  },
  comments: async () => {
    const { items, cut } = await all((query) => must(api.GET("/v1/comments", { params: { query } })));
    return { cut, entries: items.flatMap(commentEntry) };
  },
  documentation: ofDocumentation,
};

/** What is asked for while the dialog is open: each kind by itself, so that one that fails hides no other. */
export const SOURCES = Object.keys(read) as Kind[];

export const sourceQuery = (kind: Kind, t: TFunction, language: string) =>
  queryOptions({ queryKey: ["finder", kind, language], queryFn: ({ client }) => read[kind]!(t, client), staleTime: kind === "documentation" ? Infinity : 10_000, retry: false });
