import { MantineProvider } from "@mantine/core";
import { act } from "react";
import { createRoot, type Root } from "react-dom/client";
import { afterEach, beforeEach, expect, test } from "vitest";
import { PlainEntry } from "./PlainEntry";

(globalThis as { IS_REACT_ACT_ENVIRONMENT?: boolean }).IS_REACT_ACT_ENVIRONMENT = true;

let root: Root;
const taken: unknown[] = [];
const entry = () => document.querySelector("input")!;
const enter = (text: string) =>
  act(async () => {
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value")!.set!.call(entry(), text);
    entry().dispatchEvent(new Event("input", { bubbles: true }));
    entry().dispatchEvent(new FocusEvent("focusout", { bubbles: true }));
  });

beforeEach(async () => {
  taken.length = 0;
  document.body.innerHTML = "<div></div>";
  root = createRoot(document.body.firstElementChild!);
  await act(async () =>
    root.render(
      <MantineProvider>
        <PlainEntry aria-label="filter" value={80} unit="rad/s" onCommit={(next) => taken.push(next)} />
      </MantineProvider>,
    ),
  );
});
afterEach(() => act(async () => root.unmount()));

test("a value in a common unit is converted", async () => {
  await enter("100 Hz");
  expect(taken).toHaveLength(1);
  expect(taken[0]).toBeCloseTo(200 * Math.PI, 9);
});

test("a value in any other unit is refused, not dropped", async () => {
  await enter("3 kg");
  expect(taken).toEqual([]);
  expect(entry().getAttribute("aria-invalid")).toBe("true");
});
