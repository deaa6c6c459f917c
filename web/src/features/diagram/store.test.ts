import { beforeEach, expect, it } from "vitest";
import type { SystemDocument } from "@/shared/api/types";
import { useEditor } from "./store";

const named = (name: string): SystemDocument => ({ name, blocks: {}, outputs: {} });
const history = () => useEditor.temporal.getState();

beforeEach(() => useEditor.getState().start(named("first"), named("first"), "1", { places: {}, routes: {} }));

it("a gesture is undone with the places that it chose, and done again", () => {
  useEditor.getState().edit({ document: named("second"), places: { "": { u: { x: 1, y: 2 } } } });
  history().undo();
  expect(useEditor.getState()).toMatchObject({ document: named("first"), places: {} });
  history().redo();
  expect(useEditor.getState()).toMatchObject({ document: named("second"), places: { "": { u: { x: 1, y: 2 } } } });
});

it("what nobody did by hand is no gesture: a layout, a save, a start", () => {
  useEditor.getState().place("", { u: { x: 3, y: 4 } }, {});
  useEditor.getState().saved(named("first"), "2");
  expect(history().pastStates).toEqual([]);
  useEditor.getState().edit({ document: named("second") });
  useEditor.getState().start(named("third"), named("third"), "3", { places: {}, routes: {} });
  expect(history().pastStates).toEqual([]);
});

it("a save is not taken back with the gesture before it", () => {
  useEditor.getState().edit({ document: named("second") });
  useEditor.getState().saved(named("second"), "2");
  history().undo();
  expect(useEditor.getState()).toMatchObject({ document: named("first"), base: named("second"), etag: "2" });
});

it("the oldest gestures are forgotten", () => {
  for (let i = 0; i < 250; i++) useEditor.getState().edit({ document: named(String(i)) });
  expect(history().pastStates).toHaveLength(200);
});
