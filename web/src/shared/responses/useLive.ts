import { useEffect, useRef, useState } from "react";
import type { Problem } from "@/shared/api/problem";
import { LiveSocket, type LiveState } from "@/shared/live/liveSocket";
import type { Frame, MetricsMessage, Opened } from "@/shared/live/protocol";

export interface Live {
  state: LiveState;
  opened: Opened | null;
  problem: Problem | null;
  /** Of the variants that were measured, as far as they have come in. */
  measured: Map<number, MetricsMessage>;
  stale: boolean;
  set(vectors: number[][], measure: number): void;
}

/** Keeps one live channel for a page; frames go to `onFrame` at once, only what is told in text becomes state. */
export function useLive(request: object, onFrame: (frame: Frame) => void, revision: number): Live {
  const [state, setState] = useState<LiveState>("connecting");
  const [opened, setOpened] = useState<Opened | null>(null);
  const [problem, setProblem] = useState<Problem | null>(null);
  const [measured, setMeasured] = useState(new Map<number, MetricsMessage>());
  const [stale, setStale] = useState(false);
  const socket = useRef<LiveSocket | null>(null);
  const handle = useRef(onFrame);
  handle.current = onFrame;

  useEffect(() => {
    const made = new LiveSocket({
      onState: setState,
      onOpened: (message) => {
        setOpened(message);
        setProblem(null);
      },
      onFrame: (frame) => {
        // What was refused before, because the service had no time for it, is not what is shown now.
        setProblem(null);
        handle.current(frame);
      },
      onMetrics: (message) => {
        setStale(false);
        setMeasured((before) => new Map(message.variant === 0 ? [[0, message]] : [...before, [message.variant, message]]));
      },
      onProblem: setProblem,
    });
    socket.current = made;
    return () => made.close();
  }, []);
  const key = JSON.stringify(request);
  useEffect(() => socket.current?.open(JSON.parse(key) as object), [key, revision]);
  return {
    state,
    opened,
    problem,
    measured,
    stale,
    set(vectors, measure) {
      setStale(true);
      socket.current?.set(vectors, measure);
    },
  };
}
