import { expect, it } from "vitest";
import { found, indexOf, type Entry } from "./match";
import { chapters, commentEntry } from "./sources";

const entry = (title: string, more: Partial<Entry> = {}): Entry => ({ kind: "systems", title, about: "", to: `/systems/${title}`, ...more });
const titles = (entries: Entry[], text: string) => found(indexOf(entries), text).flatMap((group) => group.entries.map(({ title }) => title));

it("finds what holds every word, whatever its accents and letters", () => {
  const entries = [entry("Servo axis"), entry("Axă hidraulică"), entry("DC motor", { about: "revision 3", words: "sys_axle" })];
  expect(titles(entries, "axa")).toEqual(["Axă hidraulică"]);
  expect(titles(entries, "AXIS servo")).toEqual(["Servo axis"]);
  expect(titles(entries, "motor sys_axle")).toEqual(["DC motor"]);
  expect(titles(entries, "motor axis")).toEqual([]);
});

it("puts what begins so first, then words of the title, then what stands beside it, then the rest", () => {
  const entries = [entry("a", { words: "pump" }), entry("b", { about: "pump" }), entry("oil pump"), entry("Pump"), entry("heatpumps")];
  expect(titles(entries, "pump")).toEqual(["Pump", "oil pump", "b", "heatpumps", "a"]);
});

it("shows six of a kind and tells of the others; the documentation only to whoever asks for something", () => {
  const entries = [...Array.from({ length: 9 }, (_, i) => entry(`axis ${i}`)), entry("Axes", { kind: "documentation" })];
  expect(found(indexOf(entries), "ax").map(({ kind, entries: shown, more }) => [kind, shown.length, more])).toEqual([["systems", 6, 3], ["documentation", 1, 0]]);
  expect(found(indexOf(entries), " ").map(({ kind }) => kind)).toEqual(["systems"]);
});

it("offers comments to whoever asks for something, by the whole of their text", () => {
  const said = (about: string, text: string) => ({ id: "com_1", about, text, author: "Ana", author_id: "key_1", created_at: "2026-01-02T03:04:05Z", deletable: true });
  const long = `Rings at 80 Hz.\n${"and more ".repeat(20)}\nSerial 4711`;
  const entries = [said("job_1", long), said("sys_1", "Kept."), said("ds_1", "Loose."), said("res_1", "Serial 4711, too")].flatMap(commentEntry);
  expect(entries.map(({ to }) => to)).toEqual(["/jobs/job_1", "/systems/sys_1", "/datasets/ds_1", "/results/res_1"]);
  expect(entries[0]!.title).toMatch(/^Rings at 80 Hz\. and more .*…$/);
  expect(entries[0]!.about).toBe("Ana · 2026-01-02");
  expect(titles(entries, "serial 4711")).toEqual([entries[3]!.title, entries[0]!.title]);
  expect(titles(entries, "")).toEqual([]);
});

it("reads the chapters of the documentation without their marks", () => {
  const [one] = chapters({ items: [{ location: "catalogue/elements.html#pd2", title: "<code>pd2</code>: PD₂ &amp; lag", text: "<p>Ports: <code>in</code></p>", path: ["Reference", "Catalogue"] }] });
  expect(one).toEqual({ kind: "documentation", title: "pd2: PD₂ & lag", about: "Reference › Catalogue", words: "Ports: in", to: "/docs/catalogue/elements.html#pd2", outside: true });
});
