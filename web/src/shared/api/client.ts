import createClient, { type Middleware } from "openapi-fetch";
import { Problem } from "./problem";
import type { components, paths } from "./schema";

/** What a page must send beside the cookie with whatever changes something; known after sign-in, forgotten with the tab. */
let csrfToken: string | null = null;
let onSignedOut: () => void = () => undefined;

export function setCsrfToken(token: string | null): void {
  csrfToken = token;
}

export function whenSignedOut(react: () => void): void {
  onSignedOut = react;
}

/** Headers of a request outside of the typed client: uploads, events. */
export function csrfHeaders(): Record<string, string> {
  return csrfToken === null ? {} : { "X-CSRF-Token": csrfToken };
}

const safety: Middleware = {
  onRequest({ request }) {
    if (csrfToken !== null && request.method !== "GET") request.headers.set("X-CSRF-Token", csrfToken);
    return request;
  },
  onResponse({ response, request }) {
    if (response.status === 401 && !request.url.endsWith("/v1/session")) onSignedOut();
    return response;
  },
};

export const api = createClient<paths>({ baseUrl: globalThis.location?.origin ?? "" });
api.use(safety);

interface Reply<T> {
  data?: T;
  error?: unknown;
  response: Response;
}

/** Returns what came back, or throws the problem document that came instead; that nothing came is a problem of status 0. */
export async function must<T>(reply: Promise<Reply<T>>): Promise<T> {
  return (await answered(reply)).data as T;
}

/** The same of what a worker may compute: a request that does not prefer a job is answered with no job. */
export async function atOnce<T>(reply: Promise<Reply<T>>): Promise<Exclude<T, components["schemas"]["JobReply"]>> {
  return (await must(reply)) as Exclude<T, components["schemas"]["JobReply"]>;
}

/** The same with the entity tag, for documents that are changed later. */
export async function mustWithTag<T>(reply: Promise<Reply<T>>): Promise<{ data: T; etag: string }> {
  const found = await answered(reply);
  return { data: found.data as T, etag: found.response.headers.get("ETag") ?? "*" };
}

async function answered<T>(reply: Promise<Reply<T>>): Promise<Reply<T>> {
  let found: Reply<T>;
  try {
    found = await reply;
  } catch (error) {
    throw new Problem({ status: 0, title: "", detail: error instanceof Error ? error.message : String(error) });
  }
  if (found.error !== undefined || !found.response.ok) throw Problem.of(found.error, found.response.status);
  return found;
}
