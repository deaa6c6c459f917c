import { zodResolver } from "@hookform/resolvers/zod";
import type { Resolver } from "react-hook-form";
import { z } from "zod";
import type { Problem } from "@/shared/api/problem";
import type { AcquisitionRequest, Template } from "./api";

const positive = z.number("forms.number").positive("forms.positive");

export const schema = z.object({
  name: z.string().trim().min(1, "forms.required").max(200, "forms.longest 200"),
  channels: z.array(z.string()).min(1, "rigs.needChannel"),
  sample_rate: positive,
  duration: positive,
  pre_trigger: z.number("forms.number").min(0, "forms.notNegative"),
  averages: z.number("forms.number").int("forms.whole").min(1, "forms.positive").max(1000, "forms.atMost 1000"),
  confirm: z.boolean(),
  output: z.string(),
  /** Whether what the output is told to play is a channel of the recording, too. */
  commanded: z.boolean(),
  signal: z.enum(["step", "sine", "chirp"]),
  amplitude: z.number("forms.number"),
  frequency: positive,
  end: positive,
  trigger: z.enum(["none", "rising", "falling", "enters", "leaves"]),
  trigger_channel: z.string(),
  level: z.number("forms.number"),
  high: z.number("forms.number"),
  hysteresis: z.number("forms.number").min(0, "forms.notNegative"),
  timeout: positive.max(3600, "forms.atMost 3600"),
});
export type Fields = z.infer<typeof schema>;

/** What a form begins with for a drive: any rig may play it. */
const QUIET = { amplitude: 1, frequency: 5, end: 50 };

/** What a form begins with for a trigger. */
const IDLE = { level: 0, high: 1, hysteresis: 0, timeout: 60 };

/** What the form says of a trigger; with a drive there is none, because a drive begins at once. */
export function triggerOf({ output, trigger }: Pick<Fields, "output" | "trigger">): { waits: boolean; window: boolean } {
  const waits = output === "" && trigger !== "none";
  return { waits, window: waits && (trigger === "enters" || trigger === "leaves") };
}

/** Judges what can be seen: a number that was left wrong in a field which is not shown any more would hold the form back without a word. */
export const resolver: Resolver<Fields> = (fields, ...rest) => {
  const { waits, window } = triggerOf(fields);
  const hidden = {
    ...(fields.output === "" ? QUIET : {}),
    ...(fields.signal === "step" ? { frequency: QUIET.frequency } : {}),
    ...(fields.signal !== "chirp" ? { end: QUIET.end } : {}),
    ...(waits ? {} : IDLE),
    ...(window ? {} : { high: IDLE.high }),
  };
  return zodResolver(schema)({ ...fields, ...hidden }, ...rest);
};

/** The request that a form makes; times in s, levels of a drive in V, those of a trigger in its channel's unit, frequencies in Hz as written. */
export function requestOf(fields: Fields, rig: string): AcquisitionRequest {
  const { output, commanded, signal, amplitude, frequency, end, trigger, trigger_channel, level, high, hysteresis, timeout, ...rest } = fields;
  const hertz = (value: number) => ({ value, unit: "Hz" });
  const signals = {
    step: { kind: "step", amplitude },
    sine: { kind: "sine", amplitude, frequency: hertz(frequency) },
    chirp: { kind: "chirp", amplitude, start_frequency: hertz(frequency), end_frequency: hertz(end), duration: fields.duration },
  };
  const { waits, window } = triggerOf(fields);
  const until = window ? { window: [level, high], when: trigger } : { edge: trigger, level };
  return {
    ...rest,
    ...(output && commanded && !fields.channels.includes(output) ? { channels: [...fields.channels, output] } : {}),
    rig,
    ...(output ? { drive: { output, signal: signals[signal] } } : {}),
    ...(waits ? { trigger: { channel: fields.channels.includes(trigger_channel) ? trigger_channel : fields.channels[0], ...until, hysteresis, timeout } } : {}),
  } as AcquisitionRequest;
}

/** The request of the same channels, shown and not recorded: nothing is driven, repeated or asked of a person. */
export function liveOf(fields: Fields, rig: string): AcquisitionRequest {
  const { averages: _, confirm: __, ...rest } = requestOf({ ...fields, output: "" }, rig);
  return { ...rest, record: false };
}

function number(value: unknown, otherwise: number): number {
  if (typeof value === "number") return value;
  if (typeof value === "object" && value !== null && "value" in value && typeof value.value === "number") return value.value;
  return otherwise;
}

const SIGNALS = new Set<string>(["step", "sine", "chirp"]);

/** Whether the form can show what a template plays; a template with another signal is started as it is. */
export function editable(template: Template): boolean {
  const drive = template.document.drive;
  return drive == null || SIGNALS.has(drive.signal.kind);
}

/** Whether the form can show what a template waits for: its numbers are in the unit of the channel and of time that the form has, too. */
export function plainTrigger(template: Template): boolean {
  const numbers = Object.values(template.document.trigger ?? {}).flat() as unknown[];
  return numbers.every((value) => typeof value !== "object");
}

/** What a form begins with: a template's values, or those that suit any rig. */
export function fieldsOf(document: AcquisitionRequest | undefined, channels: string[]): Fields {
  const signal = document?.drive?.signal as unknown as Record<string, unknown> | undefined;
  const trigger = document?.trigger as unknown as Record<string, unknown> | undefined;
  const output = document?.drive?.output ?? "";
  // An input of that name comes first.
  const played = (name: string) => name === output && !channels.includes(name);
  const [low, high] = Array.isArray(trigger?.window) ? (trigger.window as unknown[]) : [trigger?.level, undefined];
  return {
    name: document?.name ?? "",
    channels: document?.channels?.filter((name) => !played(name)) ?? channels,
    sample_rate: document?.sample_rate ?? 1000,
    duration: number(document?.duration, 1),
    pre_trigger: number(document?.pre_trigger, 0),
    averages: document?.averages ?? 1,
    confirm: document?.confirm ?? true,
    output,
    commanded: document?.channels?.some(played) ?? false,
    signal: SIGNALS.has(String(signal?.kind)) ? (signal!.kind as Fields["signal"]) : "step",
    amplitude: number(signal?.amplitude, QUIET.amplitude),
    frequency: number(signal?.frequency ?? signal?.start_frequency, QUIET.frequency),
    end: number(signal?.end_frequency, QUIET.end),
    trigger: (trigger?.edge ?? trigger?.when ?? "none") as Fields["trigger"],
    trigger_channel: document?.trigger?.channel ?? "",
    level: number(low, IDLE.level),
    high: number(high, IDLE.high),
    hysteresis: number(trigger?.hysteresis, IDLE.hysteresis),
    timeout: number(trigger?.timeout, IDLE.timeout),
  };
}

/** What the service finds wrong with a drive, at the field that each fault belongs to; what belongs to none of them is about the level. */
export function driveFaults(problem: Problem | null): Partial<Record<"output" | "amplitude" | "frequency" | "end", string>> {
  const places = { output: ["/drive/output"], frequency: ["/drive/signal/frequency", "/drive/signal/start_frequency"], end: ["/drive/signal/end_frequency"] };
  const level = problem?.document.errors?.find(({ pointer }) => /^\/drive(\/|$)/.test(pointer) && !Object.values(places).flat().includes(pointer));
  const at = (pointers: string[]) => pointers.map((pointer) => problem?.at(pointer)).find((detail) => detail !== undefined);
  return { output: at(places.output), amplitude: level?.detail, frequency: at(places.frequency), end: at(places.end) };
}
