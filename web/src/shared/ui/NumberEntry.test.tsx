import { MantineProvider } from "@mantine/core";
import { act } from "react";
import { createRoot, type Root } from "react-dom/client";
import { afterEach, beforeEach, expect, test } from "vitest";
import { NumberEntry } from "./NumberEntry";

(globalThis as { IS_REACT_ACT_ENVIRONMENT?: boolean }).IS_REACT_ACT_ENVIRONMENT = true;

let root: Root;
const taken: unknown[] = [];
const give = (value: number) =>
  act(async () =>
    root.render(
      <MantineProvider>
        <NumberEntry aria-label="gain" value={value} onCommit={(next) => taken.push(next)} />
      </MantineProvider>,
    ),
  );
const entry = () => document.querySelector("input")!;
/** As a browser does it: React looks at what the element itself has kept as its value. */
const type = (text: string) =>
  act(async () => {
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value")!.set!.call(entry(), text);
    entry().dispatchEvent(new Event("input", { bubbles: true }));
  });
const press = (key: string) => act(async () => void entry().dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true, cancelable: true })));
const leave = () => act(async () => void entry().dispatchEvent(new FocusEvent("focusout", { bubbles: true })));

beforeEach(() => {
  taken.length = 0;
  document.body.innerHTML = "<div></div>";
  root = createRoot(document.body.firstElementChild!);
});
afterEach(() => act(async () => root.unmount()));

test("what is given later is shown", async () => {
  await give(1);
  await give(2);
  expect(entry().value).toBe("2");
});

test("what is given while somebody types does not type over it", async () => {
  await give(1);
  await type("2.5");
  await give(3);
  expect(entry().value).toBe("2.5");
  await press("Enter");
  expect(taken).toEqual([2.5]);
  await give(4);
  expect(entry().value).toBe("4");
});

test("what is given up is what is given by then", async () => {
  await give(1);
  await type("2.5");
  await give(3);
  await press("Escape");
  expect(entry().value).toBe("3");
  await leave();
  expect(taken).toEqual([]);
});

test("an entry is taken over once, whatever it is left by", async () => {
  await give(1);
  await type("2.5");
  await press("Enter");
  await leave();
  expect(taken).toEqual([2.5]);
});

test("what cannot be read is told, until it is given up", async () => {
  await give(1);
  await type("two");
  await press("Enter");
  expect(entry().getAttribute("aria-invalid")).toBe("true");
  await leave();
  expect(entry().getAttribute("aria-invalid")).toBe("true");
  await type("1");
  await leave();
  expect(entry().getAttribute("aria-invalid")).not.toBe("true");
  expect(taken).toEqual([]);
});

test("a number that may be two is refused with both", async () => {
  await give(5);
  await type("1,000");
  await press("Enter");
  expect(taken).toEqual([]);
  expect(entry().getAttribute("aria-invalid")).toBe("true");
  expect(entry().value).toBe("1,000");
});

test("what is taken but not kept is not shown", async () => {
  await give(5);
  await type("7");
  await press("Enter");
  expect(taken).toEqual([7]);
  expect(entry().value).toBe("5");
});
