import { expect, it } from "vitest";
import { english as en } from "./english";
import { romanian as ro } from "./romanian";

type Tree = { [key: string]: string | Tree };

function flat(tree: Tree, place = ""): Map<string, string> {
  return new Map(Object.entries(tree).flatMap(([key, value]) => (typeof value === "string" ? [[place + key, value] as const] : [...flat(value, `${place}${key}.`)])));
}

const english = flat(en);
const romanian = flat(ro);
/** Romanian has a form for 2 to 19 and one for 20 and more where English has one for all. */
const plain = (key: string) => key.replace(/_(one|few|other)$/, "");

it("says everything in both languages", () => expect([...new Set([...romanian.keys()].map(plain))].sort()).toEqual([...new Set([...english.keys()].map(plain))].sort()));

it("leaves no gap for a value out", () => {
  const gaps = (text: string) => [...text.matchAll(/\{\{(\w+)\}\}/g)].map((m) => m[1]).sort();
  for (const [key, text] of english) if (romanian.has(key)) expect([key, gaps(romanian.get(key)!)]).toEqual([key, gaps(text)]);
});

it("is translated, not copied", () => {
  const same = [...english].filter(([key, text]) => romanian.get(key) === text && /[a-z]{4,} [a-z]{3,}/i.test(text));
  expect(same).toEqual([]);
});
