// What a TypeScript program does with the types that openapi-typescript makes of the contract. Compiled and run by test_generated_clients.py.
import createClient from "openapi-fetch";
import type { components, paths } from "./schema.d.ts";

declare const process: { argv: string[] };

const [url, key] = process.argv.slice(2);
const client = createClient<paths>({ baseUrl: url, headers: { Authorization: `Bearer ${key}` } });

const document: components["schemas"]["SystemDocument"] = {
  name: "lag",
  parameters: { tau: { value: 0.2, unit: "s" } },
  blocks: {
    u: { kind: "input" },
    plant: { kind: "transfer_function", numerator: [2], denominator: ["=tau", 1] },
  },
  connections: [{ from: "u", to: "plant" }],
  outputs: { y: "plant" },
};

const made = await client.POST("/v1/systems", { body: document, params: { header: { "Idempotency-Key": "typed" } } });
if (made.error) throw new Error(made.error.detail);
const identifier: string = made.data.id;

const answered = await client.POST("/v1/simulations", {
  body: { system: identifier, input: { port: "u", signal: { kind: "step" } }, metrics: ["rise_time"], samples: 11 },
});
if (answered.error) throw new Error(answered.error.detail);
// Only who sends `Prefer: respond-async` is answered with a job.
if (answered.response.status !== 200) throw new Error(`got ${answered.response.status}`);
const simulated = answered.data as Exclude<typeof answered.data, components["schemas"]["JobReply"]>;
const [variant] = simulated.variants;
const rise: number | null = variant.metrics.y.rise_time.value;

const path = { params: { path: { identifier } } };
const etag = (await client.GET("/v1/systems/{identifier}", path)).response.headers.get("ETag");
const listed = await client.GET("/v1/systems", { params: { query: { limit: 1 } } });
const refused = await client.POST("/v1/systems", { body: { ...document, outputs: { y: "nobody" } } });
const gone = await client.DELETE("/v1/systems/{identifier}", {
  params: { path: { identifier }, header: { "If-Match": etag } },
});

console.log(
  JSON.stringify({
    rise,
    curve: variant.outputs.y.length,
    verdict: variant.verdict,
    listed: listed.data?.items.map((item) => item.id),
    identifier,
    refused: refused.error?.status,
    pointer: refused.error?.errors?.[0]?.pointer,
    gone: gone.response.status,
  }),
);
