import { beforeEach, expect, it } from "vitest";
import { isDone, placeOf, readTour, useTour } from "./tour";

beforeEach(() => localStorage.clear());

it("is offered to whoever was never here, and goes on where it was left", () => {
  expect(readTour(null).stage).toBe("study");
  expect(readTour("{{").stage).toBe("study");
  expect(readTour('{"stage": "optimise", "system": "sys_1"}')).toEqual({ stage: "optimise", system: "sys_1" });
  expect(readTour('{"stage": "panel"}').stage).toBe("study");
});

it("never comes back once it is over", () => {
  useTour.getState().go("panel", "sys_1");
  useTour.getState().go("over");
  expect(readTour(localStorage.getItem("servotune-tour")).stage).toBe("over");
});

it("knows the page of each step", () => expect([placeOf({ stage: "panel", system: "sys_1" }), placeOf({ stage: "study", system: "" })]).toEqual(["/systems/sys_1/panel", "/systems"]));

it("sees that a slider was moved and a search begun", () => {
  expect(isDone("panel", "/systems/sys_1/panel", "?s=a&in=reference")).toBe(false);
  expect(isDone("panel", "/systems/sys_1/panel", "?p.motor.leakage=0.1")).toBe(true);
  expect(isDone("optimise", "/jobs/job_1", "")).toBe(true);
});
