import type { Finding, RigDocument, RigInput, RigOutput } from "./api";

/** Something of a rig with what was found when it was tried last. */
export interface Tried {
  name: string;
  /** Model and serial number of a device, terminal of a channel. */
  doc: string;
  findings: Finding[];
}

export interface Branch extends Tried {
  channels: Tried[];
}

/** The devices of a rig with their channels, then what was found of anything else: the connection, all inputs at once, devices that are not there. */
export function hardwareOf({ devices = [], inputs = [], outputs = [], findings = [] }: RigDocument): { branches: Branch[]; others: Finding[] } {
  const rest = new Set(findings);
  const take = (what: string) => {
    const found = findings.filter((finding) => finding.what === what);
    for (const finding of found) rest.delete(finding);
    return found;
  };
  const channels = [...inputs.map((input) => ({ what: "input", ...input })), ...outputs.map((output) => ({ what: "output", ...output }))];
  const branches = devices.map(({ name, model, serial }) => ({ name, doc: [model, serial && `№ ${serial}`].filter(Boolean).join(", "), findings: take(`device ${name}`), channels: [] as Tried[] }));
  const lost: Branch = { name: "–", doc: "", findings: [], channels: [] };
  for (const { what, name, channel } of channels) {
    // A controller or a folder is one device, and its channels do not say so.
    const home = branches.find((branch) => channel.startsWith(`${branch.name}/`)) ?? (branches.length === 1 ? branches[0]! : lost);
    home.channels.push({ name, doc: channel, findings: take(`${what} ${name}`) });
  }
  return { branches: lost.channels.length > 0 ? [...branches, lost] : branches, others: [...rest] };
}

const ORDER = ["ok", "note", "fails"] as const;

/** The worst of what was found; nothing where it was not tried. */
export function worst(findings: Finding[]): Finding["result"] | undefined {
  return ORDER.findLast((result) => findings.some((finding) => finding.result === result));
}

/** The unit of what the hardware delivers. */
export function delivered(channel: RigInput | RigOutput): string {
  switch (channel.kind) {
    case "current":
      return "A";
    case "bridge":
      return "V/V";
    case "thermocouple":
      return "K";
    case "encoder":
      return (channel as RigInput).distance ? "m" : "rad";
    case "counter":
    case "digital":
      return "";
    default:
      return "V";
  }
}
