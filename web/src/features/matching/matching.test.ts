import { expect, it } from "vitest";
import contract from "../../../../openapi/openapi.json";
import type { Schemas } from "@/shared/forms/schema";
import { given, placesOf, readMatch, readMore, readSought, recordingsOf, writeMatch, writeMore, writeSought, type Experiment } from "./address";
import { directFields, methodIn, readValues } from "./direct";
import { likely } from "./sources";

it("keeps what is matched in the address, and what else is there", () => {
  const match = { system: "sys_1", dataset: "ds_1", inputs: { u: "valve" }, outputs: { y: "position", x: "" } };
  const query = writeMatch(new URLSearchParams("p=k,tau&in.old=gone"), match);
  expect(query.get("p")).toBe("k,tau");
  expect(query.has("in.old")).toBe(false);
  expect(readMatch(query)).toEqual({ ...match, outputs: { y: "position" } });
});

it("keeps what an input does between its samples, and asks for it", () => {
  const held = { system: "sys_1", dataset: "ds_1", inputs: { u: "valve", w: "load" }, outputs: { y: "position" }, between: { u: "hold" } };
  const query = writeMatch(new URLSearchParams("between.old=linear"), { ...held, between: { u: "hold", w: "" } });
  expect(readMatch(query)).toEqual(held);
  expect(recordingsOf(held, { split: 0.5, known: "" }, [])).toEqual({ dataset: "ds_1", inputs: { u: { channel: "valve", between_samples: "hold" }, w: "load" }, outputs: { y: "position" }, split: 0.5 });
  expect(readMore(writeMore(new URLSearchParams(), [{ ...laden, between: { u: "linear" } }]))).toEqual([{ ...laden, between: { u: "linear" } }]);
});

it("asks only for what has a channel", () => expect(given({ y: "position", x: "" })).toEqual({ y: "position" }));

it("takes names that agree for the same", () => {
  const channels = [{ name: "Motor_Speed", unit: "rad/s" }];
  expect([likely("motor speed", channels), likely("force", channels)]).toEqual(["Motor_Speed", ""]);
});

const first = { system: "sys_1", dataset: "ds_1", inputs: { u: "valve" }, outputs: { y: "position" } };
const laden: Experiment = { dataset: "ds_2", inputs: { u: "valve" }, outputs: { y: "position", x: "" }, split: 0, known: "load = 25 kg; current = 0.5" };

it("keeps further recordings in the address", () => {
  expect(readMore(writeMore(new URLSearchParams("p=k"), [laden]))).toEqual([laden]);
  expect(writeMore(new URLSearchParams("more=x"), []).has("more")).toBe(false);
  expect(readMore(new URLSearchParams("more={"))).toEqual([]);
});

it("has a field for every port, and none for all of them together", () => {
  const places = placesOf({ inputs: ["u"], outputs: [{ name: "y", unit: "m" }] }, "/experiments/1");
  expect(places).toEqual(["/experiments/1/dataset", "/experiments/1/split", "/experiments/1/inputs/u", "/experiments/1/outputs/y"]);
  expect(placesOf(undefined)).toEqual(["/dataset", "/split"]);
});

it("keeps what is sought in the address, with its bounds", () => {
  const sought = [{ path: "tau", upper: { value: 20, unit: "ms" } }, { path: "motor.k", lower: 0.1, upper: 2 }];
  const query = new URLSearchParams(Object.entries(writeSought(sought, ["k"])).filter((one): one is [string, string] => one[1] !== null));
  expect(readSought(query, ["k", "tau", "motor.k"], ["k"])).toEqual(sought);
  expect(writeSought([{ path: "k" }], ["k"])).toEqual({ p: null, bounds: null });
  expect(readSought(new URLSearchParams("bounds={"), ["k", "tau"], ["k"])).toEqual([{ path: "k" }]);
  expect(readSought(new URLSearchParams('p=k&bounds={"k":["x",3]}'), ["k"], [])).toEqual([{ path: "k", upper: 3 }]);
  expect(readSought(new URLSearchParams("p="), ["k"], ["k"])).toEqual([]);
});

it("asks for one recording beside its system, and for several as experiments", () => {
  expect(recordingsOf(first, { split: 0.5, known: "" }, [])).toEqual({ dataset: "ds_1", inputs: { u: "valve" }, outputs: { y: "position" }, split: 0.5 });
  expect(recordingsOf(first, { split: 1, known: "" }, [laden])).toEqual({
    experiments: [
      { dataset: "ds_1", inputs: { u: "valve" }, outputs: { y: "position" }, split: 1, parameters: {} },
      { dataset: "ds_2", inputs: { u: "valve" }, outputs: { y: "position" }, split: 0, parameters: { load: { value: 25, unit: "kg" }, current: 0.5 } },
    ],
  });
});

it("offers what each method of the contract asks", () => {
  const schemas = contract.components.schemas as unknown as Schemas;
  const names = (method: Parameters<typeof directFields>[1]) => directFields(schemas, method).map(({ name, kind }) => `${name}:${kind}`);
  expect(names("subspace")).toEqual(["inputs:ports", "outputs:ports", "between_samples:choice", "estimation:window", "offsets:choice", "orders:integers", "split:number", "validation:window"]);
  expect(names("transfer_function")).toContain("largest_delay:quantity");
  expect(names("static_curve")).toEqual(["input:channel", "output:channel", "degree:integer"]);
  expect(names("inverse_dynamics")).toEqual(expect.arrayContaining(["force:channel", "position:channel", "velocity:channel", "further:ports", "low_pass:quantity", "asymmetric:flag"]));
  expect([methodIn(new URLSearchParams("method=subspace")), methodIn(new URLSearchParams("method=x")), readValues(new URLSearchParams("f=[]"))]).toEqual(["subspace", "grey_box", {}]);
});
