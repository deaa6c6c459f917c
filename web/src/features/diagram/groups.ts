import type { ElementEntry } from "@/shared/api/types";

/** Groups of the palette in their order, each with its kinds in theirs; what the service knows besides comes last. */
const GROUPS: [group: string, kinds: readonly string[]][] = [
  ["sources", ["input", "constant", "bias"]],
  ["controllers", ["p", "pi", "pd", "pid", "pd2", "sampled_pid", "lead_lag", "feed_forward", "skyhook", "groundhook", "clipped_optimal"]],
  ["linear", ["gain", "sum", "integrator", "derivative", "transfer_function", "zero_pole_gain", "state_space", "low_pass", "notch", "delay", "rc_network"]],
  ["discrete", ["zero_order_hold", "discrete_integrator", "discrete_filter", "discrete_notch", "discrete_transfer_function", "discrete_state_space"]],
  ["nonlinear", ["saturation", "rate_limiter", "dead_zone", "backlash", "quantizer", "relay", "switch", "friction", "multiplication", "lookup_table", "function", "user_equations"]],
  ["electric", ["dc_motor", "ac_servo_axis", "power_amplifier"]],
  ["fluid", ["servo_valve", "proportional_valve", "orifice_valve", "linear_hydraulic_motor", "rotary_hydraulic_motor", "hydraulic_cylinder", "linear_pneumatic_motor", "pneumatic_cylinder"]],
  ["mechanics", ["mass_spring_damper", "two_inertia", "two_mass_correction", "gear", "ball_screw", "compliant_arm", "viscous_damper", "mr_damper_bingham", "mr_damper_dahl", "mr_damper_spencer", "passive_on", "passive_off"]],
  ["sensors", ["first_order_sensor", "velocity_transducer", "accelerometer"]],
  ["structure", ["subsystem"]],
];

/** What stands on a block in a textbook; a group's sign for the others. */
const SYMBOLS: Record<string, string> = {
  input: "→", constant: "c", bias: "+c", p: "P", pi: "PI", pd: "PD", pid: "PID", pd2: "PD₂", sampled_pid: "PID*", lead_lag: "lead", feed_forward: "FF",
  gain: "K", sum: "Σ", integrator: "∫", derivative: "d/dt", transfer_function: "B/A", zero_pole_gain: "○×", state_space: "ABCD", low_pass: "LP", notch: "∨", delay: "e⁻ˢᵀ", rc_network: "RC",
  zero_order_hold: "ZOH", discrete_integrator: "Σz", discrete_transfer_function: "z⁻¹", discrete_state_space: "ABCD*", saturation: "⌐⌐", dead_zone: "_/", relay: "⊓", quantizer: "▁▃▅", multiplication: "×", function: "f(u)", lookup_table: "u→y", user_equations: "ẋ=f",
  gear: "n₁:n₂", mass_spring_damper: "m k c", subsystem: "⧉",
};
const SIGNS: Record<string, string> = { controllers: "C", discrete: "z", nonlinear: "≁", electric: "M", fluid: "⇄", mechanics: "m", sensors: "◔", other: "□" };

export interface Group {
  group: string;
  entries: ElementEntry[];
}

/** The entries in their groups; groups of nothing are left out. */
export function groupsOf(entries: Iterable<ElementEntry>): Group[] {
  const left = new Map([...entries].map((entry) => [entry.kind, entry]));
  const found = GROUPS.map(([group, kinds]) => ({
    group,
    entries: kinds.flatMap((kind) => {
      const entry = left.get(kind);
      left.delete(kind);
      return entry ? [entry] : [];
    }),
  }));
  return [...found, { group: "other", entries: [...left.values()] }].filter(({ entries: own }) => own.length > 0);
}

export function symbolOf(kind: string): string {
  return SYMBOLS[kind] ?? SIGNS[GROUPS.find(([, kinds]) => kinds.includes(kind))?.[0] ?? "other"] ?? "□";
}

const RECENT = "servotune.recent-blocks";
const MOST = 5;

/** The kinds that were used last in this browser, the newest first. */
export function recentKinds(): string[] {
  try {
    const kept: unknown = JSON.parse(localStorage.getItem(RECENT) ?? "[]");
    return Array.isArray(kept) ? kept.filter((kind): kind is string => typeof kind === "string").slice(0, MOST) : [];
  } catch {
    return [];
  }
}

export function keepRecent(kind: string): void {
  try {
    localStorage.setItem(RECENT, JSON.stringify([kind, ...recentKinds().filter((other) => other !== kind)].slice(0, MOST)));
  } catch {
    // Without storage there is no list.
  }
}
