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

/** The same as one line for a shell. */
export function curlOf(body: object, url: string): string {
  return `curl -X POST ${url}/v1/optimizations -H "Authorization: Bearer $SERVOTUNE_KEY" -H "Content-Type: application/json" -d '${JSON.stringify(body).replaceAll("'", "'\\''")}'\n`;
}
