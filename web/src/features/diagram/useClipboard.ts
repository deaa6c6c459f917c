import { useEffect, useRef } from "react";
import type { SystemDocument } from "@/shared/api/types";
import { partOf, pasted } from "./model";

interface Props {
  document: SystemDocument;
  selected: ReadonlySet<string>;
  onCut(): void;
  onPaste(document: SystemDocument, names: string[], from: string[]): void;
}

/** Blocks travel on the machine's own clipboard, as the JSON of a system: to other systems, other tabs, and into files. */
export function useClipboard(props: Props): void {
  const latest = useRef(props);
  latest.current = props;
  useEffect(() => {
    const elsewhere = (event: ClipboardEvent) => event.target instanceof Element && event.target.closest("input, textarea, select, [role=dialog]") !== null;
    const copy = (event: ClipboardEvent) => {
      const { document, selected } = latest.current;
      if (elsewhere(event) || selected.size === 0 || !event.clipboardData) return;
      event.preventDefault();
      event.clipboardData.setData("text/plain", JSON.stringify(partOf(document, selected)));
    };
    const cut = (event: ClipboardEvent) => {
      copy(event);
      if (event.defaultPrevented) latest.current.onCut();
    };
    const paste = (event: ClipboardEvent) => {
      if (elsewhere(event)) return;
      const part = partRead(event.clipboardData?.getData("text/plain") ?? "");
      if (!part) return;
      event.preventDefault();
      const { document, names } = pasted(latest.current.document, part);
      latest.current.onPaste(document, names, Object.keys(part.blocks));
    };
    window.addEventListener("copy", copy);
    window.addEventListener("cut", cut);
    window.addEventListener("paste", paste);
    return () => {
      window.removeEventListener("copy", copy);
      window.removeEventListener("cut", cut);
      window.removeEventListener("paste", paste);
    };
  }, []);
}

/** Text of a clipboard that is a part of a system; nothing where it is something else. */
export function partRead(text: string): SystemDocument | undefined {
  let found: unknown;
  try {
    found = JSON.parse(text);
  } catch {
    return undefined;
  }
  const record = (value: unknown): value is Record<string, unknown> => typeof value === "object" && value !== null && !Array.isArray(value);
  if (!record(found) || !record(found.blocks)) return undefined;
  const blocks = Object.entries(found.blocks);
  if (blocks.length === 0 || !blocks.every(([, block]) => record(block) && typeof block.kind === "string")) return undefined;
  const wires = Array.isArray(found.connections) ? found.connections.filter((wire) => record(wire) && typeof wire.from === "string" && typeof wire.to === "string") : [];
  return { blocks: found.blocks as SystemDocument["blocks"], connections: wires as SystemDocument["connections"] & object, outputs: {} };
}
