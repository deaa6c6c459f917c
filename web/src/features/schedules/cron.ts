import cronstrue from "cronstrue";
import "cronstrue/locales/ro";

/** An expression in words, "At 02:30, Monday through Friday"; null where it is none. */
export function cronWords(expression: string, language: string): string | null {
  try {
    return cronstrue.toString(expression, { locale: language, use24HourTimeFormat: true, verbose: false });
  } catch {
    return null;
  }
}

/** Instants that people ask for most; a form begins with one of them. */
export const PRESETS = { nightly: "30 2 * * *", weekdays: "0 6 * * mon-fri", weekly: "0 3 * * sun", hourly: "0 * * * *", monthly: "0 4 1 * *" } as const;

/** The time zones that this browser knows; its own first. */
export function timeZones(): string[] {
  const own = Intl.DateTimeFormat().resolvedOptions().timeZone;
  return [...new Set([own, "UTC", ...Intl.supportedValuesOf("timeZone")])];
}

/** A moment as the clocks of a time zone show it, of 24 hours as the words of its expression are. */
export function zoned(at: string, zone: string, language: string): string {
  return new Intl.DateTimeFormat(language, { timeZone: zone, weekday: "long", day: "numeric", month: "long", hour: "2-digit", minute: "2-digit", hourCycle: "h23", timeZoneName: "short" }).format(new Date(at));
}

/** How far a moment is away: "in 3 hours". */
export function away(at: string, now: number, language: string): string {
  const seconds = (new Date(at).getTime() - now) / 1000;
  const words = new Intl.RelativeTimeFormat(language, { numeric: "auto" });
  for (const [unit, size] of [["day", 86_400], ["hour", 3600], ["minute", 60]] as const) if (Math.abs(seconds) >= size) return words.format(Math.round(seconds / size), unit);
  return words.format(Math.round(seconds), "second");
}
