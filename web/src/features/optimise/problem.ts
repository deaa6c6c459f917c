import type { ProblemForm } from "@/shared/systems/search";
import { readScenarios } from "@/shared/systems/scenarios";

export interface Domains {
  /** What a metric needs: "time", "path", "loop" or "system". */
  get(metric: string): string | undefined;
}

/** Goals of these are said with a band, or with a curve that another is held against: a form of two bounds cannot say them. */
const WITH_MORE = new Set(["band_energy", "envelope", "tracking_error"]);

/** The metrics that a row can ask for; what it already asks for stays among them. */
export function goalMetrics<M extends { kind: string; domain: string }>(metrics: Iterable<M>, loops: string[], asked: string): M[] {
  return [...metrics].filter(({ kind, domain }) => kind === asked || !(WITH_MORE.has(kind) || kind.endsWith("_bound") || (domain === "loop" && loops.length === 0)));
}

/** The body of an optimisation, in the words of the contract. */
export function bodyOf(form: ProblemForm, system: string, domains: Domains): Record<string, unknown> {
  const goals = form.goals.map((goal) => {
    const domain = domains.get(goal.metric);
    const where = domain === "loop" ? { open_at: form.loop } : domain === "path" ? { from: form.input, to: goal.output } : domain === "system" ? {} : { experiment: "step", output: goal.output };
    return { metric: goal.metric, ...where, ...(goal.sense ? { sense: goal.sense } : {}), ...(goal.lower !== undefined ? { lower: goal.lower } : {}), ...(goal.upper !== undefined ? { upper: goal.upper } : {}) };
  });
  const scenarios = readScenarios(form.scenarios);
  return {
    system,
    variables: form.variables.map(({ parameter, lower, upper }) => ({ parameter, ...(lower !== undefined ? { lower } : {}), ...(upper !== undefined ? { upper } : {}) })),
    experiments: [{ name: "step", input: { port: form.input, signal: { kind: "step", amplitude: form.amplitude } } }],
    goals,
    ...(scenarios && scenarios.length > 0 ? { scenarios: [{}, ...scenarios] } : {}),
    method: { kind: form.method, ...form.options },
  };
}

/** A script that asks the same through the client library. */
export function pythonOf(body: object, url: string): string {
  const literal = (value: unknown, indent: string): string => {
    const inner = `${indent}    `;
    if (value === null || value === undefined) return "None";
    if (typeof value === "boolean") return value ? "True" : "False";
    if (Array.isArray(value)) return value.length === 0 ? "[]" : `[\n${value.map((v) => `${inner}${literal(v, inner)},\n`).join("")}${indent}]`;
    if (typeof value === "object") {
      const entries = Object.entries(value);
      return entries.length === 0 ? "{}" : `{\n${entries.map(([k, v]) => `${inner}${JSON.stringify(k)}: ${literal(v, inner)},\n`).join("")}${indent}}`;
    }
    return JSON.stringify(value);
  };
  const { system, ...rest } = body as { system: unknown };
  const named = Object.entries(rest).map(([key, value]) => `    ${key}=${literal(value, "    ")},\n`).join("");
  return `import servotune\n\nclient = servotune.connect(${JSON.stringify(url)}, key="...")\njob = client.optimize(\n    ${literal(system, "    ")},\n${named})\nresult = job.wait()\nprint(result["best"])\n`;
}

export function curlOf(body: object, url: string): string {
  return `curl -X POST ${url}/v1/optimizations -H "Authorization: Bearer $SERVOTUNE_KEY" -H "Content-Type: application/json" -d '${JSON.stringify(body).replaceAll("'", "'\\''")}'\n`;
}
