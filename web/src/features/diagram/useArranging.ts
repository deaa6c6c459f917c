import { useReactFlow } from "@xyflow/react";
import { useCallback, useEffect } from "react";
import type { SystemDocument } from "@/shared/api/types";
import { laidOut } from "./layout";
import type { Catalogue } from "./model";
import { useEditor } from "./store";

export const FIT = { padding: 0.08, maxZoom: 1.2 };

/** Lays the blocks of a system out, once by itself where nobody has; `laid` tells whether there is a picture yet. */
export function useArranging(document: SystemDocument, scopeKey: string, catalogue: Catalogue) {
  const flow = useReactFlow();
  const { places, place } = useEditor();
  const arranged = places[scopeKey] !== undefined;
  const arrange = useCallback(
    async (asked = true) => {
      let laid: Awaited<ReturnType<typeof laidOut>> | undefined;
      try {
        laid = await laidOut(document, catalogue);
      } finally {
        // What was put somewhere while the layout was computed stays there; without a layout blocks stand somewhere, but are seen.
        const now = useEditor.getState().places[scopeKey];
        place(scopeKey, asked ? { ...now, ...laid?.places } : { ...laid?.places, ...now }, laid?.routes ?? {});
      }
      requestAnimationFrame(() => void flow.fitView(FIT));
    },
    [document, catalogue, scopeKey, place, flow],
  );
  const empty = Object.keys(document.blocks).length === 0;
  useEffect(() => {
    // A diagram that nobody has arranged is laid out once; blocks that come later are put where they were dropped.
    if (!arranged && !empty) void arrange(false);
    else requestAnimationFrame(() => void flow.fitView(FIT));
  }, [scopeKey]);
  return { arrange, laid: arranged || empty };
}
