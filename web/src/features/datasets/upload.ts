import { api, csrfHeaders, must } from "@/shared/api/client";
import { Problem } from "@/shared/api/problem";
import { Sha256 } from "./sha256";

const SEGMENT = 4 << 20;
const KEY = (file: File) => `servotune-upload-${file.name}-${file.size}-${file.lastModified}`;

async function sha256(part: ArrayBuffer): Promise<string> {
  const digest = await crypto.subtle.digest("SHA-256", part);
  return [...new Uint8Array(digest)].map((byte) => byte.toString(16).padStart(2, "0")).join("");
}

function put(url: string, part: Blob, onProgress: (sent: number) => void, signal: AbortSignal): Promise<void> {
  // fetch() tells nothing of how far an upload is.
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("PUT", url);
    request.setRequestHeader("Content-Type", "application/octet-stream");
    for (const [name, value] of Object.entries(csrfHeaders())) request.setRequestHeader(name, value);
    request.upload.onprogress = (event) => onProgress(event.loaded);
    request.onload = () => (request.status < 300 ? resolve() : reject(Problem.of(parsed(request.responseText), request.status)));
    request.onerror = () => reject(new Problem({ status: 0, title: "", detail: "the connection was lost" }));
    request.onabort = () => reject(new DOMException("aborted", "AbortError"));
    signal.addEventListener("abort", () => request.abort());
    request.send(part);
  });
}

function parsed(text: string): unknown {
  try {
    return JSON.parse(text);
  } catch {
    return text;
  }
}

/** The dataset that an interrupted upload of this very file was for. */
export function interrupted(file: File): string | null {
  return localStorage.getItem(KEY(file));
}

/** The pieces of a file in their order, and the sum of the whole: what the service is told when it is all there. */
export interface Manifest {
  segments: string[];
  sha256: string;
}

const MANIFEST = (id: string) => `servotune-manifest-${id}`;

/** What was sent for a recording that waits to be described; null in another browser than the one that sent it. */
export function manifestOf(id: string): Manifest | null {
  const kept = localStorage.getItem(MANIFEST(id));
  return kept === null ? null : (JSON.parse(kept) as Manifest);
}

export function forgetManifest(id: string): void {
  localStorage.removeItem(MANIFEST(id));
}

/**
 * Sends a file in verified segments and returns the dataset's id. What the service has already is not sent again: an upload that was
 * interrupted goes on where it was.
 */
export async function upload(file: File, request: object, onProgress: (part: number) => void, signal: AbortSignal): Promise<string> {
  const kept = interrupted(file);
  let id = kept;
  const present = new Set<string>();
  if (kept) {
    let cursor: string | undefined;
    do {
      const found = await api.GET("/v1/datasets/{identifier}/segments", { params: { path: { identifier: kept }, query: { limit: 1000, cursor } } });
      if (!found.data) id = null;
      for (const segment of found.data?.items ?? []) present.add(segment.sha256);
      cursor = found.data?.next_cursor ?? undefined;
    } while (cursor !== undefined);
  }
  if (id === null) {
    id = (await must(api.POST("/v1/datasets", { body: request as never }))).id;
    localStorage.setItem(KEY(file), id);
  }
  const segments: string[] = [];
  // Of the whole as its pieces pass: it never is in memory at once.
  const whole = new Sha256();
  for (let start = 0; start < file.size; start += SEGMENT) {
    const part = file.slice(start, Math.min(start + SEGMENT, file.size));
    const bytes = await part.arrayBuffer();
    whole.update(new Uint8Array(bytes));
    const digest = await sha256(bytes);
    // Whoever has stopped while nothing was being sent is heard, too.
    signal.throwIfAborted();
    segments.push(digest);
    if (!present.has(digest)) await put(`/v1/datasets/${id}/segments/${digest}`, part, (sent) => onProgress((start + sent) / file.size), signal);
    onProgress(Math.min(1, (start + part.size) / file.size));
  }
  localStorage.setItem(MANIFEST(id), JSON.stringify({ segments, sha256: whole.hex() } satisfies Manifest));
  localStorage.removeItem(KEY(file));
  return id;
}
