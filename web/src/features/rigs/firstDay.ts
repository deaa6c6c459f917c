import { calibrationState, type Finding, type RigDocument } from "./api";

/** A line of the list of the first day: how it stands, nothing while nobody can tell, and the channels or devices that it is about. */
export interface Step {
  what: "agent" | "hardware" | "devices" | "inputs" | "outputs" | "calibrations" | "limits" | "recording";
  result: Finding["result"] | undefined;
  names: string[];
}

/** What a lab goes through before it trusts a rig, as far as the service can tell. */
export function firstDay({ inputs = [], outputs = [], findings = [] }: RigDocument, { present, recorded, today }: { present: boolean; recorded: boolean; today: string }): Step[] {
  const named = (group: string, result: Finding["result"]) => [...new Set(findings.filter((finding) => finding.what.startsWith(`${group} `) && finding.result === result).map((finding) => finding.what.slice(group.length + 1)))];
  const tried = (what: Step["what"], group: string): Step => {
    const [failing, noted] = [named(group, "fails"), named(group, "note")];
    const result = findings.length === 0 ? undefined : failing.length > 0 ? "fails" : noted.length > 0 ? "note" : named(group, "ok").length > 0 ? "ok" : undefined;
    return { what, result, names: failing.length > 0 ? failing : noted };
  };
  const hardware = findings.filter((finding) => finding.what === "hardware");
  const states = inputs.flatMap((input) => [input, ...(input.chain ?? [])].map((part) => ({ name: input.name, state: calibrationState(part.calibration, today) })));
  const of = (...wanted: string[]) => [...new Set(states.filter((one) => wanted.includes(one.state)).map((one) => one.name))];
  const [overdue, doubtful] = [of("overdue"), of("soon", "none")];
  // A line has neither a rate of change nor a way home.
  const boundless = outputs.filter((output) => output.duration == null || (output.kind !== "digital" && (output.slew == null || !output.soft_stop))).map((output) => output.name);
  return [
    { what: "agent", result: present ? "ok" : "fails", names: [] },
    { what: "hardware", result: hardware.some((finding) => finding.result === "fails") ? "fails" : hardware[0]?.result, names: [] },
    tried("devices", "device"),
    tried("inputs", "input"),
    ...(outputs.length > 0 ? [tried("outputs", "output")] : []),
    { what: "calibrations", result: overdue.length > 0 ? "fails" : doubtful.length > 0 ? "note" : "ok", names: overdue.length > 0 ? overdue : doubtful },
    ...(outputs.length > 0 ? ([{ what: "limits", result: boundless.length > 0 ? "note" : "ok", names: boundless }] as const) : []),
    { what: "recording", result: recorded ? "ok" : undefined, names: [] },
  ];
}
