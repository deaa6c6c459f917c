import { api, must } from "@/shared/api/client";
import { Problem } from "@/shared/api/problem";
import { readFrame, type Frame, type LiveMessage, type MetricsMessage, type Opened } from "./protocol";

export type LiveState = "connecting" | "open" | "lost";

export interface LiveHandlers {
  onState(state: LiveState): void;
  onOpened(opened: Opened): void;
  onFrame(frame: Frame): void;
  onMetrics(message: MetricsMessage): void;
  onProblem(problem: Problem): void;
}

const LONGEST_PAUSE = 8000;

/**
 * The channel of a front panel. One request is on its way at a time, and only the newest waits behind it; when the service goes
 * away the channel comes back by itself, opens what was open and asks again for what was asked last.
 */
export class LiveSocket {
  private socket: WebSocket | null = null;
  private opening: object | null = null;
  private opened = false;
  private vectors: number[][] | null = null;
  private measure = 1;
  private seq = 0;
  private waiting = false;
  private dirty = false;
  private pause = 250;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private ended = false;

  constructor(private readonly handlers: LiveHandlers) {
    void this.connect();
  }

  open(request: object): void {
    this.opening = request;
    this.opened = false;
    this.vectors = null;
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ type: "open", ...request }));
  }

  set(vectors: number[][], measure: number): void {
    this.vectors = vectors;
    this.measure = measure;
    this.dirty = true;
    this.flush();
  }

  close(): void {
    this.ended = true;
    clearTimeout(this.timer);
    this.socket?.close();
  }

  private async connect(): Promise<void> {
    this.handlers.onState("connecting");
    let ticket: string;
    try {
      ticket = (await must(api.POST("/v1/tickets"))).ticket;
    } catch (error) {
      if (error instanceof Problem && error.status === 401) return;
      return this.retry();
    }
    if (this.ended) return;
    const socket = new WebSocket(`${location.origin.replace(/^http/, "ws")}/v1/live?ticket=${encodeURIComponent(ticket)}`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    socket.onopen = () => {
      this.pause = 250;
      this.waiting = false;
      this.handlers.onState("open");
      if (this.opening) socket.send(JSON.stringify({ type: "open", ...this.opening }));
    };
    socket.onmessage = (event) => this.hear(event.data as ArrayBuffer | string);
    socket.onclose = () => {
      this.opened = false;
      if (!this.ended) this.retry();
    };
  }

  private retry(): void {
    if (this.ended) return;
    this.handlers.onState("lost");
    this.timer = setTimeout(() => void this.connect(), this.pause);
    this.pause = Math.min(this.pause * 2, LONGEST_PAUSE);
  }

  private hear(data: ArrayBuffer | string): void {
    if (typeof data !== "string") {
      const frame = readFrame(data);
      if (frame.seq === this.seq) this.waiting = false;
      this.handlers.onFrame(frame);
      return this.flush();
    }
    const message = JSON.parse(data) as LiveMessage;
    if (message.type === "opened") {
      this.opened = true;
      this.waiting = false;
      this.handlers.onOpened(message);
      if (this.vectors) this.dirty = true;
      this.flush();
    } else if (message.type === "metrics") {
      // What is being opened anew is still to be measured: the numbers of what was open are not its own.
      if (this.opened && message.seq === this.seq) this.handlers.onMetrics(message);
    } else {
      this.waiting = false;
      this.handlers.onProblem(new Problem(message.problem));
      this.flush();
    }
  }

  private flush(): void {
    if (!this.opened || this.waiting || !this.dirty || !this.vectors || this.socket?.readyState !== WebSocket.OPEN) return;
    this.seq += 1;
    this.waiting = true;
    this.dirty = false;
    this.socket.send(JSON.stringify({ type: "set", seq: this.seq, vectors: this.vectors, measure: this.measure }));
  }
}
