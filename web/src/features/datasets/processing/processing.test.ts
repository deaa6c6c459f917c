import { expect, it } from "vitest";
import contract from "../../../../../openapi/openapi.json";
import { english } from "@/locales/english";
import { fieldsOf, UNITS, type Schemas } from "@/shared/forms/schema";
import { channelsBefore, gaps, readPlan, requestOf, stepKinds, writePlan, type Plan } from "./steps";

const schemas = contract.components.schemas as unknown as Schemas;
const kinds = stepKinds(schemas);
const plan: Plan = { name: "ready", others: ["ds_2"], combine: "side_by_side", steps: [{ kind: "cut", start: 0.1, end: "" }, { kind: "filter", band: "low_pass", frequency: { value: 50, unit: "Hz" }, channels: [] }, { kind: "differentiate", channel: "y", name: "v" }] };

it("knows every step of the contract", () => expect([...kinds.keys()].sort()).toEqual(["calibrate", "cut", "decimate", "detrend", "differentiate", "fill", "filter", "integrate", "resample", "select"]));

it("has a word for each field and kind, and a unit for each quantity", () => {
  const all = [...[...kinds.values()].flat(), ...["BlackBoxRequest", "InverseDynamicsRequest", "StaticCurveRequest"].flatMap((name) => fieldsOf(schemas[name]!, ["dataset", "method"]))];
  expect(all.filter(({ name }) => !(name in english.fields)).map(({ name }) => name)).toEqual([]);
  expect([...kinds.keys()].filter((kind) => !(kind in english.process.kinds))).toEqual([]);
  expect(all.filter(({ kind, name }) => ["quantity", "edges", "window"].includes(kind) && !(name in UNITS)).map(({ name }) => name)).toEqual([]);
  expect(all.flatMap(({ choices }) => choices).filter((choice) => !(choice in english.choices))).toEqual([]);
});

it("is held by the address", () => expect(readPlan(writePlan(plan))).toEqual(plan));
it("is nothing where the address is cut short", () => expect(readPlan(new URLSearchParams("steps=[{")).steps).toEqual([]));

it("sends what was filled in", () =>
  expect(requestOf(plan, "ds_1", kinds)).toEqual({ name: "ready", sources: ["ds_1", "ds_2"], combine: "side_by_side", steps: [{ kind: "cut", start: 0.1 }, { kind: "filter", band: "low_pass", frequency: { value: 50, unit: "Hz" } }, { kind: "differentiate", channel: "y", name: "v" }] }));

it("tells what is missing", () => expect(gaps({ ...plan, steps: [{ kind: "filter" }] }, kinds)).toEqual(["0.band", "0.frequency"]));

it("knows what earlier steps have made", () => {
  expect(channelsBefore(["y"], plan.steps, 3)).toEqual(["y", "v"]);
  expect(channelsBefore(["y", "u"], [{ kind: "select", channels: ["u"] }], 1)).toEqual(["u"]);
});
