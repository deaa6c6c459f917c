import { beforeEach, describe, expect, it } from "vitest";
import { readScenarios } from "@/shared/systems/scenarios";
import type { ProblemForm } from "@/shared/systems/search";
import { addressOf, formAt, wholeOf } from "./address";
import { adviceOf } from "./advice";
import { curlOf, pythonOf } from "./copy";
import { readCurve } from "./curves";
import { boundUnit } from "./Goals";
import { bodyOf, goalMetrics, rowsOf } from "./problem";
import { fieldOf, search, type Goal, type Search } from "./schema";

const domains = new Map([["overshoot", "time"], ["envelope", "time"], ["band_energy", "time"], ["tracking_error", "time"], ["bandwidth", "path"], ["phase_margin", "loop"], ["sensitivity_bound", "loop"], ["damping_ratio", "system"]]);
const short: ProblemForm = {
  input: "r",
  amplitude: 0.1,
  loop: "e",
  variables: [{ parameter: "kp", lower: 1 }],
  goals: [
    { metric: "overshoot", output: "y", sense: "", upper: 0.05 },
    { metric: "bandwidth", output: "y", sense: "maximize" },
    { metric: "phase_margin", output: "y", sense: "", lower: { value: 45, unit: "deg" } },
    { metric: "damping_ratio", output: "y", sense: "", lower: 0.3 },
  ],
  scenarios: "m = 2k; load = 5 daN\n",
  method: "gradient",
  options: { starts: 4 },
};
const form: Search = wholeOf(short);
const goal: Goal = { metric: "overshoot", output: "y", experiment: "", from: "r", loop: "e", sense: "minimize", soft: false };
const load = { name: "load", commands: [{ port: "load", signal: { kind: "step", amplitude: 100 } }], duration: 3 };

it("the few things that another page knows become the body of the contract", () =>
  expect(bodyOf(form, "sys_1", domains)).toEqual({
    system: "sys_1",
    variables: [{ parameter: "kp", lower: 1 }],
    experiments: [{ name: "step", input: { port: "r", signal: { kind: "step", amplitude: 0.1 } } }],
    goals: [
      { metric: "overshoot", experiment: "step", output: "y", upper: 0.05 },
      { metric: "bandwidth", from: "r", to: "y", sense: "maximize" },
      { metric: "phase_margin", open_at: "e", lower: { value: 45, unit: "deg" } },
      { metric: "damping_ratio", lower: 0.3 },
    ],
    scenarios: [{}, { m: 2000, load: { value: 5, unit: "daN" } }],
    method: { kind: "gradient", starts: 4 },
  }));

describe("everything that a request may hold", () => {
  it("variables are ranges, whole numbers, lists, or tied", () =>
    expect(
      bodyOf({ ...form, variables: [{ parameter: "a", chosen: "range", lower: 1, upper: 2, start: 1.5, scale: "log", expression: "=b" }, { parameter: "n", chosen: "whole", upper: 9 }, { parameter: "d", chosen: "list", choices: [1, 2], lower: 0 }, { parameter: "b", chosen: "tied", expression: "=a/2", lower: 1 }] }, "s", domains).variables,
    ).toEqual([{ parameter: "a", lower: 1, upper: 2, start: 1.5, scale: "log" }, { parameter: "n", upper: 9, integer: true }, { parameter: "d", choices: [1, 2] }, { parameter: "b", expression: "=a/2" }]));
  it("a goal without an experiment is one in each, and faults find its row", () => {
    const asked: Search = { ...form, experiments: [...form.experiments, load], goals: [goal, { ...goal, experiment: "load", target: 0.1, tolerance: 0.01, soft: true, weight: 3, sense: "" }, { ...goal, metric: "bandwidth" }] };
    expect(bodyOf(asked, "s", domains).goals).toEqual([
      { metric: "overshoot", experiment: "step", output: "y", sense: "minimize" },
      { metric: "overshoot", experiment: "load", output: "y", sense: "minimize" },
      { metric: "overshoot", experiment: "load", output: "y", target: 0.1, tolerance: 0.01, weight: 3, hard: false },
      { metric: "bandwidth", from: "r", to: "y", sense: "minimize" },
    ]);
    expect(rowsOf(asked, domains)).toEqual([0, 0, 1, 2]);
    expect(bodyOf(asked, "s", domains).experiments).toEqual([{ name: "step", input: form.experiments[0]!.commands[0] }, { name: "load", input: load.commands[0], duration: 3 }]);
  });
  it("goals are held against bands, curves over time and over frequency", () =>
    expect(
      bodyOf({ ...form, goals: [{ ...goal, metric: "band_energy", band: [1, 2] }, { ...goal, metric: "tracking_error", reference: "0: 0; 1: 2" }, { ...goal, metric: "envelope", sense: "", upperCurve: "0: 1.1; 500 ms: 1", curveScale: 2 }, { ...goal, metric: "sensitivity_bound", sense: "", upperCurve: "1 0 / 1 2", lowerCurve: " " }] }, "s", domains).goals,
    ).toEqual([
      { metric: "band_energy", experiment: "step", output: "y", sense: "minimize", band: [1, 2] },
      { metric: "tracking_error", experiment: "step", output: "y", sense: "minimize", reference: [[0, 0], [1, 2]] },
      { metric: "envelope", experiment: "step", output: "y", bounds: { upper: [[0, 1.1], [0.5, 1]], scale: 2 } },
      { metric: "sensitivity_bound", open_at: "e", bounds: { upper: { numerator: [1, 0], denominator: [1, 2] } } },
    ]));
  it("a metric that takes a number is asked for with it", () =>
    expect(bodyOf({ ...form, goals: [{ ...goal, metric: "recovery_time", number: 0.05 }, { ...goal, metric: "settling_time" }, { ...goal, metric: "overshoot", number: 3 }] }, "s", new Map([...domains, ["recovery_time", "time"], ["settling_time", "time"]])).goals).toEqual([
      { metric: "recovery_time", experiment: "step", output: "y", sense: "minimize", recovery_band: 0.05 },
      { metric: "settling_time", experiment: "step", output: "y", sense: "minimize" },
      { metric: "overshoot", experiment: "step", output: "y", sense: "minimize" },
    ]));
  it("a goal of a response may refuse values that have not settled; one of a loop has none", () =>
    expect(bodyOf({ ...form, goals: [{ ...goal, settled: true }, { ...goal, settled: false }, { ...goal, metric: "phase_margin", settled: true }] }, "s", domains).goals).toEqual([
      { metric: "overshoot", experiment: "step", output: "y", sense: "minimize", accept: "ok" },
      { metric: "overshoot", experiment: "step", output: "y", sense: "minimize" },
      { metric: "phase_margin", open_at: "e", sense: "minimize" },
    ]));
  it("ranges, draws, other structures, other methods, its turn", () =>
    expect(bodyOf({ ...form, scenarios: "", uncertain: [{ parameter: "m", lower: 1, upper: 2 }], draws: 256, across: "mean", structures: [{ id: "sys_2", name: "PD" }], others: ["global"], priority: "low", limit: 60, method: "grid", options: { points: [5, 7], sampling: "full" }, variables: [...form.variables, { parameter: "kd", chosen: "tied", expression: "=kp" }, { parameter: "ki", chosen: "range" }] }, "s", domains)).toMatchObject({
      uncertain: [{ parameter: "m", lower: 1, upper: 2 }],
      yield_samples: 256,
      across_scenarios: "mean",
      alternatives: [{ name: "this system" }, { name: "PD", system: "sys_2" }],
      cross_check: ["global"],
      queue: { priority: "low", time_limit: 60 },
      method: { kind: "grid", points: { kp: 5, ki: 7 }, sampling: "full" },
    }));
});

it("curves are read as people write them", () => {
  expect(readCurve("0: 1.1; 500 ms: 5 %", "time")).toEqual([[0, 1.1], [0.5, { value: 5, unit: "%" }]]);
  expect(readCurve("1 0.2 / 1 3 2", "frequency")).toEqual({ numerator: [1, 0.2], denominator: [1, 3, 2] });
  for (const text of ["", "0: 1", "0: 1; 2", "0: 1: 2; 3: 4", "a: 1; b: 2"]) expect(readCurve(text, "time")).toBeUndefined();
  expect(readCurve("1 / 2", "time")).toBeUndefined();
  expect(readCurve("1 x / 2", "frequency")).toBeUndefined();
});

it("a row offers the metrics that the system has a place for", () => {
  const metrics = [...domains].map(([kind, domain]) => ({ kind, domain }));
  const offered = (loops: string[], asked: string) => goalMetrics(metrics, loops, asked).map((m) => m.kind);
  expect(offered(["e"], "overshoot")).toEqual([...domains.keys()]);
  expect(offered([], "overshoot")).not.toContain("phase_margin");
  expect(offered([], "phase_margin")).toContain("phase_margin");
});

it("bounds have the unit of the output where the metric takes it from there", () => expect([boundUnit({ unit: "s" }), boundUnit({ unit: "output" }, "m"), boundUnit({ unit: "output**2*s" }, "m/s"), boundUnit({ unit: "output*s" }, ""), boundUnit({ unit: "output/input" }, "m"), boundUnit({ unit: "1" })]).toEqual(["s", "m", "(m/s)**2*s", "s", "", ""]));

it("a method is advised on before it runs", () => {
  const metrics = new Map([...domains].map(([kind, domain]) => [kind, { domain }]));
  const advice = (part: Partial<Search>) => adviceOf({ ...form, ...part }, undefined, metrics).map(({ key, values }) => [key.split(".").at(-1), values?.total ?? values?.objectives]);
  expect(advice({ method: "grid", options: { points: 5 }, variables: [...form.variables, { parameter: "d", chosen: "list", choices: [1, 2, 3] }, { parameter: "b", chosen: "tied", expression: "=d" }] })).toEqual([["grid", 15]]);
  expect(advice({ goals: [{ ...goal, sense: "", upper: 1 }] })).toEqual([["noObjective", undefined]]);
  expect(advice({ method: "pareto", goals: [goal] })).toEqual([["oneObjective", undefined]]);
  expect(advice({ method: "global", goals: [goal, goal] })).toEqual([["weighted", 2]]);
  expect(advice({ method: "convex", goals: [goal] })).toEqual([["convex", undefined]]);
});

describe("scenarios", () => {
  it("that cannot be read are none", () => expect(readScenarios("m : 5")).toBeUndefined());
  it("may be left out", () => expect(readScenarios("\n")).toEqual([]));
});

it("is copied as Python and for a shell", () => {
  const body = bodyOf({ ...form, scenarios: "" }, "sys_1", domains);
  expect(pythonOf(body, "http://host")).toContain('job = client.optimize(\n    "sys_1",\n    variables=[\n        {\n            "parameter": "kp",');
  expect(curlOf({ name: "it's" }, "http://host")).toContain(`'{"name":"it'\\''s"}'`);
});

describe("the form", () => {
  const faults = (changed: Partial<Search>) => (search.safeParse({ ...form, scenarios: "", ...changed }).error?.issues ?? []).map((issue) => `${issue.path.join(".")}: ${issue.message}`);
  it("that makes sense has no faults", () => expect(faults({})).toEqual([]));
  it("tells what is wrong where it is", () => {
    expect(faults({ variables: [{ parameter: "kp", chosen: "range", lower: 2, upper: 1 }, { parameter: "kp", chosen: "list" }, { parameter: "b", chosen: "tied", expression: "=" }] })).toEqual(["variables.0.upper: optimise.order", "variables.1.parameter: optimise.twice", "variables.1.choices: optimise.noChoices", "variables.2.expression: optimise.noExpression"]);
    expect(faults({ experiments: [load, load, { ...load, name: " " }] })).toEqual(["experiments.1.name: optimise.twice", "experiments.2.name: optimise.unnamed"]);
    expect(faults({ uncertain: [{ parameter: "m", lower: 2, upper: 1 }, { parameter: "n" }] })).toEqual(["uncertain.0.upper: optimise.order", "uncertain.1.lower: optimise.bothEnds", "uncertain.1.upper: optimise.bothEnds"]);
    expect(faults({ scenarios: "nothing" })).toEqual(["scenarios: optimise.badScenario"]);
  });
  it.each<[Partial<Goal>, string[]]>([
    [{ sense: "" }, ["sense: optimise.nothing"]],
    [{ sense: "", metric: "envelope", upperCurve: "0: 1; 1: 1" }, []],
    [{ target: 1, upper: 2 }, ["target: optimise.targetAlone"]],
    [{ tolerance: 1 }, ["tolerance: optimise.toleranceAlone"]],
    [{ target: 0 }, ["tolerance: optimise.toleranceOfZero"]],
    [{ soft: true }, ["soft: optimise.softWithout"]],
    [{ weight: 0 }, ["weight: optimise.weightSign"]],
    [{ metric: "band_energy", band: [1, undefined] }, ["band: optimise.noBand"]],
    [{ metric: "tracking_error", reference: "0 1" }, ["reference: optimise.noCurve"]],
    [{ metric: "recovery_time" }, ["number: optimise.noNumber"]],
    [{ metric: "settling_time" }, []],
    [{ metric: "sensitivity_bound" }, ["upperCurve: optimise.noCurve"]],
    [{ metric: "sensitivity_bound", lowerCurve: "1: 2" }, ["lowerCurve: optimise.noCurve"]],
  ])("a goal with %j", (part, expected) => expect(faults({ goals: [{ ...goal, ...part }] })).toEqual(expected.map((fault) => `goals.0.${fault}`)));
  it.each([
    ["/variables/1/upper", "variables.1.upper"],
    ["/variables/0", "variables.0.parameter"],
    ["/variables/0/choices/2", "variables.0.choices"],
    ["/goals/2/upper/unit", "goals.1.upper"],
    ["/goals/0/open_at", "goals.0.loop"],
    ["/goals/0/hard", "goals.0.soft"],
    ["/goals/0/accept", "goals.0.settled"],
    ["/goals/0/bounds/lower/3", "goals.0.lowerCurve"],
    ["/goals/0/bounds/upper", "goals.0.upperCurve"],
    ["/goals/9", "goals.9.metric"],
    ["/scenarios/1/motor.mass", "scenarios"],
    ["/method/points", "options.points"],
    ["/experiments/0/input", "experiments.0.commands.0.port"],
    ["/experiments/0/input/signal/amplitude", "experiments.0.commands.0.signal.amplitude"],
    ["/experiments/1/input/1/signal/command/frequency/unit", "experiments.1.commands.1.signal.command.frequency"],
    ["/experiments/1/input/signal", "experiments.1.commands.0.signal.kind"],
    ["/experiments/1/duration", "experiments.1.duration"],
    ["/uncertain/0/lower", "uncertain.0.lower"],
    ["/queue/time_limit", "limit"],
    ["/system", null],
  ])("%s belongs to the field %s", (pointer, field) => expect(fieldOf(pointer, [0, 0, 1])).toBe(field));
});

describe("the address", () => {
  const kept = new Map<string, string>();
  beforeEach(() => {
    kept.clear();
    Object.assign(globalThis, { sessionStorage: { getItem: (key: string) => kept.get(key) ?? null, setItem: (key: string, value: string) => kept.set(key, value) } });
  });
  it("holds the form", () => expect(formAt("sys_1", addressOf("sys_1", form))).toEqual(form));
  it("holds the few things of another page", () => expect(formAt("sys_1", JSON.stringify(short))).toEqual(form));
  it("is none of a form", () => expect(["{", "3", "{}", "draft", "", null].map((text) => formAt("sys_1", text))).toEqual([null, null, null, null, null, null]));
  it("leaves a long form beside it, for its own system", () => {
    const long = { ...form, scenarios: "m = 1\n".repeat(2000) };
    expect(addressOf("sys_1", long)).toBe("draft");
    expect(formAt("sys_1", "draft")).toEqual(long);
    expect(formAt("sys_2", "draft")).toBeNull();
  });
});

it("a structure by its parts: what is chosen of a removed block falls away, its own ranges come besides", () => {
  const structure = { id: "", name: "with a lead", removed: ["law", "error → plant"], added: '{"blocks": {"lead": {"kind": "lead_lag"}}}', ranges: "lead.zero = 1 ... 100" };
  const body = bodyOf({ ...form, structures: [structure], variables: [{ parameter: "law.kp", chosen: "range", lower: 1, upper: 2 }, { parameter: "m", chosen: "range", lower: 3, upper: 4 }], deadline: "2026-12-01T18:00:00.000Z" }, "s", domains);
  expect(body.alternatives).toEqual([
    { name: "this system" },
    {
      name: "with a lead",
      remove: { blocks: ["law"], connections: [{ from: "error", to: "plant" }] },
      add: { blocks: { lead: { kind: "lead_lag" } } },
      variables: [{ parameter: "m", lower: 3, upper: 4 }, { parameter: "lead.zero", lower: 1, upper: 100 }],
    },
  ]);
  expect(body.queue).toEqual({ deadline: "2026-12-01T18:00:00.000Z" });
  expect(search.safeParse({ ...form, structures: [{ ...structure, added: "{", ranges: "lead.zero" }] }).error?.issues.map(({ path }) => path.join("."))).toEqual(["structures.0.added", "structures.0.ranges"]);
  expect(fieldOf("/alternatives/1/add/blocks/lead")).toBe("structures.0.added");
});
