import { useQueryClient } from "@tanstack/react-query";
import { useEffect, useState } from "react";

export interface Best {
  evaluation: number;
  objective: number;
  violation: number;
  /** Of the design variables, SI. */
  values?: Record<string, number>;
}

const BEST = /best after (\d+) evaluations: objective (\S+), violation (\S+) at(.*)/;

/** What a message tells of the search, if it does. */
export function bestOf(message: string): Best | null {
  const found = BEST.exec(message);
  if (!found) return null;
  const objective = Number(found[2]!.replace(/,$/, ""));
  const values = Object.fromEntries(found[4]!.split(",").flatMap((part) => {
    const [name = "", value] = part.split(" = ");
    return value !== undefined && Number.isFinite(Number(value)) ? [[name.trim(), Number(value)]] : [];
  }));
  return Number.isFinite(objective) ? { evaluation: Number(found[1]), objective, violation: Number(found[3]), values } : null;
}

export interface Followed {
  progress: number | null;
  messages: string[];
  best: Best[];
}

const START: Followed = { progress: null, messages: [], best: [] };

/** Follows a job that has not ended; the browser itself takes the stream up again where it broke off. */
export function useEvents(id: string, running: boolean): Followed {
  const queries = useQueryClient();
  const [followed, setFollowed] = useState<Followed>(START);
  useEffect(() => {
    if (!running) return;
    setFollowed(START);
    const source = new EventSource(`/v1/jobs/${id}/events`);
    source.addEventListener("progress", (event) => {
      const { progress, message } = JSON.parse(event.data as string) as { progress: number; message: string };
      setFollowed((before) => ({ ...before, progress, messages: message && message !== before.messages.at(-1) ? [...before.messages, message].slice(-50) : before.messages }));
    });
    source.addEventListener("message", (event) => {
      const { message } = JSON.parse(event.data as string) as { message: string };
      const best = bestOf(message);
      setFollowed((before) => ({ ...before, messages: [...before.messages, message].slice(-50), best: best ? [...before.best, best].slice(-2000) : before.best }));
    });
    source.addEventListener("status", (event) => {
      const { status } = JSON.parse(event.data as string) as { status: string };
      if (["succeeded", "failed", "cancelled"].includes(status)) source.close();
      void queries.invalidateQueries({ queryKey: ["job", id] });
      void queries.invalidateQueries({ queryKey: ["jobs"] });
    });
    return () => source.close();
  }, [id, running, queries]);
  return followed;
}
