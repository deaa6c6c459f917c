import { expect, it } from "vitest";
import { away, cronWords, zoned } from "./cron";

it("says when in both languages", () => {
  expect(cronWords("30 2 * * mon-fri", "en")).toBe("At 02:30, Monday through Friday");
  expect(cronWords("30 2 * * mon-fri", "ro")).toMatch(/02:30.*luni/);
  expect(cronWords("@daily", "en")).toBe("At 00:00");
  expect(cronWords("61 25 * * *", "en")).toBeNull();
});

it("shows a moment on the clocks of the place", () => {
  // Bucharest has UTC+2 in winter.
  expect(zoned("2026-11-23T00:30:00Z", "Europe/Bucharest", "en-GB")).toContain("02:30");
});

it("says how far away it is", () => {
  const now = Date.parse("2026-11-23T00:00:00Z");
  expect(away("2026-11-23T03:00:00Z", now, "en")).toBe("in 3 hours");
  expect(away("2026-11-22T00:00:00Z", now, "en")).toBe("yesterday");
});
