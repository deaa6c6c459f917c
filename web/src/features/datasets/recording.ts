/** Samples of the longest segment that a spectrum takes unless told otherwise: more lines than a plot shows apart, and a reply of some MB. */
const SEGMENT_SAMPLES = 131_072;

/**
 * Seconds of the segments that the spectrum of a long stretch averages unless told otherwise. None where the service's own choice, the
 * shortest of the experiments in the stretch, is no longer: a segment that none of them could hold would be refused.
 */
export function usualSegment(from: number, to: number, rate: number | null | undefined, experiments?: readonly number[] | null): number | undefined {
  if (!rate) return undefined;
  let end = 0;
  const parts = (experiments ?? []).map((count) => {
    const start = end;
    end += count;
    return Math.min(to, end / rate) - Math.max(from, start / rate);
  });
  const shortest = Math.min(to - from, ...parts.filter((seconds) => seconds > 0));
  return shortest > SEGMENT_SAMPLES / rate ? SEGMENT_SAMPLES / rate : undefined;
}

/** The stretch of a recording that an address names, s; all of it where it names none that there is. */
export function stretchOf(query: URLSearchParams, end: number): [number, number] {
  const instant = (key: string, otherwise: number) => (query.has(key) ? Math.min(end, Math.max(0, Number(query.get(key)))) : otherwise);
  const [from, to] = [instant("from", 0), instant("to", end)];
  return from < to ? [from, to] : [0, end];
}

/** Channels that are drawn unless others are chosen: each is a plot, and a request with every zoom. */
const DRAWN = 8;

/** The channels that an address names as `show`, in the order of the recording; the first ones where it names none. */
export function drawnOf(query: URLSearchParams, names: string[]): string[] {
  const chosen = names.filter((name) => query.getAll("show").includes(name));
  return chosen.length > 0 ? chosen : names.slice(0, DRAWN);
}
