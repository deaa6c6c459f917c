import { MantineProvider } from "@mantine/core";
import { QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { act } from "react";
import { createRoot, type Root } from "react-dom/client";
import { afterEach, beforeEach, expect, test, vi } from "vitest";
import { Comments } from "./Comments";

(globalThis as { IS_REACT_ACT_ENVIRONMENT?: boolean }).IS_REACT_ACT_ENVIRONMENT = true;

/** The client of the service takes the browser's fetch when it is made, which is before anything else here. */
const asks = vi.hoisted(() => {
  const found: { service: (request: Request) => Promise<Response> } = { service: () => Promise.reject(new Error("nobody answers")) };
  globalThis.fetch = ((request: Request) => found.service(request)) as typeof fetch;
  return found;
});

interface Said {
  id: string;
  about: string;
  text: string;
  author: string;
  author_id: string;
  created_at: string;
  deletable: boolean;
}

let root: Root;
/** What the service has, newest first, what it was asked, and what it answers to whoever writes. */
let kept: Said[] = [];
let asked: string[] = [];
let refusal: { status: number; detail: string } | null = null;

const said = (id: string, text: string, deletable = false): Said => ({ id, about: "sys_1", text, author: "Ana", author_id: "key_1", created_at: "2026-01-02T03:04:05Z", deletable });
const reply = (status: number, body?: unknown) => new Response(body === undefined ? null : JSON.stringify(body), { status, headers: { "Content-Type": "application/json" } });

async function service(request: Request): Promise<Response> {
  const { pathname, search } = new URL(request.url);
  asked.push(`${request.method} ${pathname}${search}`);
  if (request.method === "GET") return reply(200, { items: kept, next_cursor: null });
  if (refusal) return reply(refusal.status, { title: "no", status: refusal.status, detail: refusal.detail });
  if (request.method === "DELETE") {
    kept = kept.filter(({ id }) => !pathname.endsWith(id));
    return reply(204);
  }
  const { text } = (await request.json()) as { text: string };
  kept = [said(`com_${kept.length + 1}`, text, true), ...kept];
  return reply(201, kept[0]);
}

const settle = () => act(async () => void (await new Promise((done) => setTimeout(done))));
/** Waits until something is so, as often as the page is drawn anew. */
async function until(so: () => boolean) {
  for (let turn = 0; turn < 200 && !so(); turn++) await settle();
  expect(so()).toBe(true);
}
const texts = () => [...document.querySelectorAll("li")].map((item) => item.lastElementChild?.textContent);
const field = () => document.querySelector("textarea")!;
const button = (name: string) => [...document.querySelectorAll("button")].find((one) => (one.getAttribute("aria-label") ?? one.textContent) === name)!;
const press = (name: string) => act(async () => button(name).click());
const type = (text: string) =>
  act(async () => {
    Object.getOwnPropertyDescriptor(HTMLTextAreaElement.prototype, "value")!.set!.call(field(), text);
    field().dispatchEvent(new Event("input", { bubbles: true }));
  });

beforeEach(() => {
  [kept, asked, refusal] = [[], [], null];
  asks.service = service;
  document.body.innerHTML = "<div></div>";
  root = createRoot(document.body.firstElementChild!);
});
afterEach(() => act(async () => root.unmount()));

async function shown() {
  const queries = new QueryClient({ defaultOptions: { queries: { retry: false } } });
  await act(async () =>
    root.render(
      <MantineProvider env="test">
        <QueryClientProvider client={queries}>
          <Comments about="sys_1" />
        </QueryClientProvider>
      </MantineProvider>,
    ),
  );
  await until(() => asked.some((one) => one.startsWith("GET /v1/comments?about=sys_1")));
}

test("says that there is nothing yet, and then what was written", async () => {
  await shown();
  await until(() => document.body.textContent.includes("comments.none"));
  expect(button("comments.write").disabled).toBe(true);
  await type("Rings at 80 Hz.");
  await press("comments.write");
  await until(() => texts().includes("Rings at 80 Hz."));
  expect(field().value).toBe("");
  expect(document.body.textContent).not.toContain("comments.none");
});

test("what is written is text, line by line, and no page", async () => {
  kept = [said("com_1", "<b>80 Hz</b>\nand more")];
  await shown();
  await until(() => texts().length === 1);
  expect(texts()).toEqual(["<b>80 Hz</b>\nand more"]);
  expect(document.querySelector("li b")).toBeNull();
  expect(button("comments.deleteOf")).toBeUndefined();
});

test("is written with Ctrl and Enter, blanks are not", async () => {
  await shown();
  const enter = () => act(async () => void field().dispatchEvent(new KeyboardEvent("keydown", { key: "Enter", ctrlKey: true, bubbles: true, cancelable: true })));
  await type("   ");
  await enter();
  await type("by keyboard");
  await enter();
  await until(() => texts().includes("by keyboard"));
  expect(asked.filter((one) => one.startsWith("POST"))).toEqual(["POST /v1/comments"]);
});

test("what the service refuses is told, and what was written stays", async () => {
  await shown();
  refusal = { status: 403, detail: "the key must have the scope write" };
  await type("kept here");
  await press("comments.write");
  await until(() => document.querySelector("[role=alert]") !== null);
  expect(document.querySelector("[role=alert]")!.textContent).toContain("the key must have the scope write");
  expect(field().value).toBe("kept here");
});

test("one's own is deleted after it was asked once more", async () => {
  kept = [said("com_2", "mine", true), said("com_1", "hers")];
  await shown();
  await until(() => texts().length === 2);
  await press("comments.deleteOf");
  await press("comments.keep");
  expect(asked.some((one) => one.startsWith("DELETE"))).toBe(false);
  await press("comments.deleteOf");
  await press("comments.forGood");
  await until(() => texts().length === 1);
  expect(texts()).toEqual(["hers"]);
  expect(asked).toContain("DELETE /v1/comments/com_2");
});
