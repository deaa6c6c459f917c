import { MantineProvider } from "@mantine/core";
import { act } from "react";
import { createRoot, type Root } from "react-dom/client";
import { afterEach, beforeEach, expect, test } from "vitest";
import { ParamSlider } from "./ParamSlider";

(globalThis as { IS_REACT_ACT_ENVIRONMENT?: boolean }).IS_REACT_ACT_ENVIRONMENT = true;

let root: Root;
const moved: number[] = [];
const settled: number[] = [];
const nothing = () => undefined;
/** The service describes a parameter anew whenever the panel is opened anew: equal, but another object. */
const told = (knob: boolean, value = 6) =>
  act(async () =>
    root.render(
      <MantineProvider>
        <ParamSlider
          parameter={{ path: "k", value: 6, unit: "1", lower: 1, upper: 11, scale: "linear", doc: "", bound: false }}
          value={value}
          influence={null}
          metric=""
          knob={knob}
          scale="linear"
          onMove={(_, next) => moved.push(next)}
          onCommit={(_, next) => settled.push(next)}
          onRemove={nothing}
          onKnob={nothing}
          onScale={nothing}
        />
      </MantineProvider>,
    ),
  );
const key = (kind: "keydown" | "keyup") => act(async () => void document.querySelector("[role=slider], [type=range]")!.dispatchEvent(new KeyboardEvent(kind, { key: "ArrowRight", shiftKey: true, bubbles: true, cancelable: true })));

beforeEach(() => {
  moved.length = settled.length = 0;
  document.body.innerHTML = "<div></div>";
  root = createRoot(document.body.firstElementChild!);
});
afterEach(() => act(async () => root.unmount()));

test.each([false, true])("what is held goes on from where it is, whatever is told of it meanwhile (knob: %s)", async (knob) => {
  await told(knob);
  await key("keydown");
  await told(knob);
  await key("keydown");
  await key("keyup");
  // Each key with Shift is a tenth of the travel from 1 to 11.
  expect(moved.map((value) => Number(value.toFixed(9)))).toEqual([7, 8]);
  expect(settled).toEqual(moved.slice(1));
  await told(knob, 2);
  await key("keydown");
  expect(moved.at(-1)).toBeCloseTo(3, 9);
});
