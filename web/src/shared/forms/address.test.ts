import { expect, it } from "vitest";
import { z } from "zod";
import { readFields, withParameters, writeFields } from "./address";
import { ruleAndValue } from "./faults";

const schema = z.object({
  name: z.string().min(1),
  rate: z.number().positive().max(100),
  rest: z.number().optional(),
  kind: z.enum(["sine", "step"]),
  confirm: z.boolean(),
  channels: z.array(z.string()),
});
type Fields = z.infer<typeof schema>;
const begin: Fields = { name: "", rate: 10, rest: undefined, kind: "sine", confirm: true, channels: ["a"] };
const filled: Fields = { name: "12", rate: 0.5, rest: -2, kind: "step", confirm: false, channels: ["a", "b, c"] };

const address = (fields: Fields, prefix = "") => withParameters(new URLSearchParams("template=t"), writeFields(fields, begin, prefix));
const back = (query: URLSearchParams | string) => readFields(new URLSearchParams(query), begin, schema.shape);

it("holds what was filled in, and what else is there", () => {
  expect(back(address(filled))).toEqual(filled);
  expect(address(filled).get("template")).toBe("t");
  expect(readFields(address(filled, "new."), begin, schema.shape, "new.")).toEqual(filled);
});

it("holds nothing of what a form begins with", () => {
  expect(address(begin).toString()).toBe("template=t");
  expect(withParameters(address(filled), writeFields(begin, begin)).toString()).toBe("template=t");
});

it("is the same address where nothing changes", () => {
  const query = address(filled);
  expect(withParameters(query, writeFields(filled, begin))).toBe(query);
});

it("keeps an entry that was emptied, and one that is wrong, to be told at its field", () => {
  expect(back(address({ ...filled, rate: NaN }))).toEqual({ ...filled, rate: NaN });
  expect(back(address({ ...filled, rate: 1000 })).rate).toBe(1000);
  expect(readFields(new URLSearchParams("rest="), { ...begin, rest: 3 }, schema.shape).rest).toBeUndefined();
});

it.each(["rate=fast", "rate=%22fast%22", "rate={", "kind=square", "confirm=1", "channels=a", "channels=[1]", "other=1"])("begins as ever where the address says %s", (query) => expect(back(query)).toEqual(begin));

it("names the rule and the value", () => {
  const t = ((key: string, values?: Record<string, unknown>) => `${key}${JSON.stringify(values ?? {})}`) as never;
  expect(ruleAndValue(t, "forms.atMost 100", 250)).toBe('forms.got{"rule":"forms.atMost{\\"limit\\":\\"100\\"}","value":"250"}');
  expect(ruleAndValue(t, "matching.share", 1.5, 0.01)).toContain('"value":"150"');
  expect(ruleAndValue(t, "forms.required", "")).toBe("forms.required{}");
});
