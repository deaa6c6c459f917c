import { createHash } from "node:crypto";
import { readdirSync, readFileSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { gzipSync } from "node:zlib";
import react from "@vitejs/plugin-react";
import { defineConfig, type Plugin } from "vitest/config";

const OUT = "../api/static";

/** Assets are compressed once, here: the service sends the .gz beside each file. */
function precompress(): Plugin {
  return {
    name: "precompress",
    apply: "build",
    closeBundle() {
      const assets = fileURLToPath(new URL(`${OUT}/assets/`, import.meta.url));
      for (const name of readdirSync(assets)) {
        if (/\.(js|css|svg)$/.test(name)) writeFileSync(`${assets}${name}.gz`, gzipSync(readFileSync(assets + name), { level: 9 }));
      }
    },
  };
}

/** Script of the first visit, compressed, bytes: what the entry imports before anything is asked for. */
const FIRST_LOAD = 350_000;

/** A build whose first load is too large fails. */
function firstLoad(): Plugin {
  return {
    name: "first-load",
    apply: "build",
    writeBundle(_, bundle) {
      const files = new Set<string>();
      const collect = (file: string) => {
        const chunk = bundle[file];
        if (chunk?.type !== "chunk" || files.has(file)) return;
        files.add(file);
        chunk.imports.forEach(collect);
      };
      for (const chunk of Object.values(bundle)) if (chunk.type === "chunk" && chunk.isEntry) collect(chunk.fileName);
      const size = [...files].reduce((sum, file) => sum + gzipSync((bundle[file] as { code: string }).code, { level: 9 }).length, 0);
      if (size > FIRST_LOAD) this.error(`the first load must be at most ${FIRST_LOAD} bytes of compressed script, got ${size} in ${[...files].join(", ")}`);
    },
  };
}

/** The reference of the interface at /docs/api: a finished viewer, copied as it is under names that tell its content. */
function reference(): Plugin {
  return {
    name: "reference",
    apply: "build",
    closeBundle() {
      const at = (path: string) => fileURLToPath(new URL(path, import.meta.url));
      const kept = (path: string, name: string, ending: string) => {
        const content = readFileSync(at(path));
        const file = `${name}-${createHash("sha256").update(content).digest("hex").slice(0, 8)}.${ending}`;
        writeFileSync(at(`${OUT}/assets/${file}`), content);
        return `/assets/${file}`;
      };
      const page = readFileSync(at("reference/index.html"), "utf-8")
        .replace("__STYLES__", kept("node_modules/swagger-ui-dist/swagger-ui.css", "swagger-ui", "css"))
        .replace("__COLOURS__", kept("reference/colours.css", "reference", "css"))
        .replace("__VIEWER__", kept("node_modules/swagger-ui-dist/swagger-ui-bundle.js", "swagger-ui", "js"))
        .replace("__START__", kept("reference/start.js", "reference", "js"));
      writeFileSync(at(`${OUT}/reference.html`), page);
    },
  };
}

/** What the page at /docs/api asks for; in development it is the running service's. */
const REFERENCE = ["/assets/swagger-ui-", "/assets/reference-"];

const service = process.env.SERVOTUNE_URL ?? "http://127.0.0.1:8000";

export default defineConfig({
  plugins: [react(), firstLoad(), reference(), precompress()],
  resolve: { alias: { "@": fileURLToPath(new URL("./src", import.meta.url)) } },
  build: { outDir: OUT, emptyOutDir: true, target: "es2023", manifest: true, chunkSizeWarningLimit: 2000, assetsInlineLimit: 0 },
  server: {
    port: 5173,
    // `make web-dev`: pages from here with hot reload, everything else from a running service.
    proxy: Object.fromEntries(["/v1", "/openapi.json", "/docs", ...REFERENCE, "/readyz", "/sign-in"].map((path) => [path, { target: service, ws: true }])),
  },
  test: { environment: "happy-dom", include: ["src/**/*.test.{ts,tsx}"] },
});
