import { act } from "react";
import { createRoot, type Root } from "react-dom/client";
import { createMemoryRouter, RouterProvider } from "react-router";
import { afterEach, beforeEach, expect, test } from "vitest";
import { useQueryText, type ChangeQuery } from "./useQueryText";

(globalThis as { IS_REACT_ACT_ENVIRONMENT?: boolean }).IS_REACT_ACT_ENVIRONMENT = true;

let root: Root;
/** Lets the page arrive that has to be loaded first. */
let arrive: () => void;
const told: Record<string, ChangeQuery> = {};
const put = (key: string, value: string) => (query: URLSearchParams) => {
  query.set(key, value);
  return query;
};

function Part({ name }: { name: string }) {
  const [query, change] = useQueryText();
  told[name] = change;
  return <p id={name}>{query.toString()}</p>;
}

async function page(at: string) {
  const element = (
    <>
      <Part name="one" />
      <Part name="other" />
    </>
  );
  const later = () => new Promise<{ element: typeof element }>((done) => (arrive = () => done({ element })));
  const router = createMemoryRouter([{ path: "/page", element }, { path: "/elsewhere", element }, { path: "/later", lazy: later }], { initialEntries: [at] });
  await act(async () => root.render(<RouterProvider router={router} />));
  return router;
}

beforeEach(() => {
  document.body.innerHTML = "<div></div>";
  root = createRoot(document.body.firstElementChild!);
});
afterEach(() => act(async () => root.unmount()));

test("two changes of one moment are both there, whoever makes them", async () => {
  const router = await page("/page?kept=1");
  await act(async () => {
    told.one!(put("a", "1"));
    told.one!(put("b", "2"));
    told.other!(put("c", "3"));
  });
  expect(router.state.location.search).toBe("?kept=1&a=1&b=2&c=3");
  expect(document.getElementById("other")!.textContent).toBe("kept=1&a=1&b=2&c=3");
});

test("a change that was kept since an earlier picture begins with what is there now", async () => {
  const router = await page("/page");
  const kept = told.one!;
  await act(async () => told.other!(put("a", "1")));
  await act(async () => told.other!(put("b", "2")));
  await act(async () => kept(put("c", "3")));
  expect(router.state.location.search).toBe("?a=1&b=2&c=3");
});

test("the way back shows what was there, and what is changed then begins with that", async () => {
  const router = await page("/page?a=1");
  await act(async () => told.one!(put("a", "2"), {}));
  await act(async () => router.navigate(-1));
  expect(router.state.location.search).toBe("?a=1");
  await act(async () => told.one!(put("b", "3")));
  expect(router.state.location.search).toBe("?a=1&b=3");
});

test("another page knows nothing of it", async () => {
  const router = await page("/page");
  await act(async () => told.one!(put("a", "1")));
  await act(async () => router.navigate("/elsewhere"));
  await act(async () => told.one!(put("b", "2")));
  expect(router.state.location.pathname + router.state.location.search).toBe("/elsewhere?b=2");
});

test("whoever is on the way to another page is not called back by the one that is left", async () => {
  const router = await page("/page");
  await act(async () => void router.navigate("/later"));
  await act(async () => told.one!(put("a", "1")));
  await act(async () => arrive());
  expect(router.state.location.pathname + router.state.location.search).toBe("/later");
  expect(document.getElementById("one")).not.toBeNull();
});

test("a change that changes nothing goes nowhere", async () => {
  const router = await page("/page?a=1");
  const { key } = router.state.location;
  await act(async () => told.one!(put("a", "1")));
  expect(router.state.location.key).toBe(key);
});
