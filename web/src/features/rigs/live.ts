import { useQueryClient } from "@tanstack/react-query";
import { useEffect, useState } from "react";

/** What the service sends while samples come: lowest and highest value of each channel, one pair for each step of time. */
export interface Preview {
  start: number;
  step: number;
  /** Number of a sweep that is shown and not recorded: the piece is all of it up to now. */
  sweep?: number;
  channels: Record<string, [number | null, number | null][]>;
}

export interface Live {
  time: number[];
  channels: Record<string, { low: number[]; high: number[] }>;
}

/** The longest picture that is kept: older samples are in the recording. */
const MOST = 6000;

/** Puts a piece behind what was shown before; where one got lost, the gap stays one. A sweep takes the place of what was there. */
export function joined(shown: Live | null, piece: Preview): Live {
  const before = piece.sweep === undefined ? shown : null;
  const count = Math.max(...Object.values(piece.channels).map((pairs) => pairs.length), 0);
  const time = before ? [...before.time] : [];
  const channels: Live["channels"] = {};
  for (const [name, old] of Object.entries(before?.channels ?? {})) channels[name] = { low: [...old.low], high: [...old.high] };
  const last = time.at(-1);
  if (last !== undefined && piece.start - last > 1.5 * piece.step) time.push(last + piece.step);
  for (let i = 0; i < count; i++) time.push(piece.start + i * piece.step);
  const names = new Set([...Object.keys(channels), ...Object.keys(piece.channels)]);
  for (const name of names) {
    const curve = (channels[name] ??= { low: [], high: [] });
    const pairs = piece.channels[name] ?? [];
    while (curve.low.length < time.length - count) {
      curve.low.push(NaN);
      curve.high.push(NaN);
    }
    for (let i = 0; i < count; i++) {
      curve.low.push(pairs[i]?.[0] ?? NaN);
      curve.high.push(pairs[i]?.[1] ?? NaN);
    }
  }
  const cut = Math.max(0, time.length - MOST);
  if (cut === 0) return { time, channels };
  return { time: time.slice(cut), channels: Object.fromEntries(Object.entries(channels).map(([name, { low, high }]) => [name, { low: low.slice(cut), high: high.slice(cut) }])) };
}

/** Makes the axis of a sweep as long as the whole one will be, s: nothing moves while it grows. */
export function upTo({ time, channels }: Live, end: number): Live {
  if (time.length === 0 || time.at(-1)! >= end) return { time, channels };
  return { time: [...time, end], channels: Object.fromEntries(Object.entries(channels).map(([name, { low, high }]) => [name, { low: [...low, NaN], high: [...high, NaN] }])) };
}

export interface Followed {
  live: Live | null;
  progress: number | null;
  message: string;
  /** Whether nothing more will come. */
  ended: boolean;
}

const START: Followed = { live: null, progress: null, message: "", ended: false };

/** Follows the latest attempt of a measurement; the browser takes the stream up again where it broke off. */
export function useMeasurement(id: string, attempt: number, over: boolean): Followed {
  const queries = useQueryClient();
  const [followed, setFollowed] = useState<Followed>(START);
  useEffect(() => {
    setFollowed(START);
    if (attempt === 0) return;
    const source = new EventSource(`/v1/acquisitions/${id}/events`);
    source.addEventListener("progress", (event) => {
      const { progress, message } = JSON.parse(event.data as string) as { progress: number | null; message?: string };
      setFollowed((before) => ({ ...before, progress: progress ?? before.progress, message: message ?? before.message }));
    });
    source.addEventListener("message", (event) => {
      const { message } = JSON.parse(event.data as string) as { message?: string };
      if (message) setFollowed((before) => ({ ...before, message }));
    });
    source.addEventListener("preview", (event) => {
      const piece = JSON.parse(event.data as string) as Preview;
      setFollowed((before) => ({ ...before, live: joined(before.live, piece) }));
    });
    source.addEventListener("status", (event) => {
      const { status } = JSON.parse(event.data as string) as { status: string };
      if (["succeeded", "failed", "cancelled"].includes(status)) {
        source.close();
        setFollowed((before) => ({ ...before, ended: true }));
      }
      void queries.invalidateQueries({ queryKey: ["acquisition", id] });
    });
    return () => source.close();
    // `over` is there so that a measurement that was over and is tried again is followed anew.
  }, [id, attempt, over, queries]);
  return followed;
}
