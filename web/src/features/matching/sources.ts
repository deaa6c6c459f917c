import type { Dataset } from "@/shared/api/datasets";
import type { Opened } from "@/shared/live/protocol";

export interface Channel {
  name: string;
  unit: string;
}

export function channelsOf(dataset: Dataset | undefined): Channel[] {
  return (dataset?.channels ?? []).map((channel) => ({ name: String(channel.name), unit: String(channel.unit ?? "") }));
}

/** The channel that has the port's own name, if there is one: what a form begins with. */
export function likely(port: string, channels: Channel[]): string {
  const plain = (text: string) => text.toLowerCase().replace(/[^a-z0-9]/g, "");
  return channels.find((channel) => plain(channel.name) === plain(port))?.name ?? "";
}

/** Channels for all ports by their names; null where no name agrees. */
export function guessed(opened: Opened, dataset: Dataset): { inputs: Record<string, string>; outputs: Record<string, string> } | null {
  const channels = channelsOf(dataset);
  const inputs = Object.fromEntries(opened.inputs.map((port) => [port, likely(port, channels)]));
  const outputs = Object.fromEntries(opened.outputs.map(({ name }) => [name, likely(name, channels)]));
  return [...Object.values(inputs), ...Object.values(outputs)].some((channel) => channel !== "") ? { inputs, outputs } : null;
}
