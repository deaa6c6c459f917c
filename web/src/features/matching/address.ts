/** What both forms are about, in the address: `system`, `dataset`, `in.<port>` and `out.<output>` with their channels. */
export interface Match {
  system: string;
  dataset: string;
  inputs: Record<string, string>;
  outputs: Record<string, string>;
}

export function readMatch(query: URLSearchParams): Match {
  const found: Match = { system: query.get("system") ?? "", dataset: query.get("dataset") ?? "", inputs: {}, outputs: {} };
  for (const [key, value] of query) {
    if (key.startsWith("in.")) found.inputs[key.slice(3)] = value;
    else if (key.startsWith("out.")) found.outputs[key.slice(4)] = value;
  }
  return found;
}

export function writeMatch(query: URLSearchParams, match: Match): URLSearchParams {
  const next = new URLSearchParams([...query].filter(([key]) => !/^(in|out)\.|^(system|dataset)$/.test(key)));
  if (match.system) next.set("system", match.system);
  if (match.dataset) next.set("dataset", match.dataset);
  for (const [port, channel] of Object.entries(match.inputs)) if (channel) next.set(`in.${port}`, channel);
  for (const [output, channel] of Object.entries(match.outputs)) if (channel) next.set(`out.${output}`, channel);
  return next;
}

/** Only the ports that have a channel: what a request names. */
export function given(ports: Record<string, string>): Record<string, string> {
  return Object.fromEntries(Object.entries(ports).filter(([, channel]) => channel !== ""));
}
