import { useEffect, useRef, useState, type RefObject } from "react";

/** Brings the first thing that is wrong into sight and the cursor into its field, once it has been drawn; `tell` says that there is one. */
export function useFirstFault(): { form: RefObject<HTMLFormElement | null>; tell(): void } {
  const form = useRef<HTMLFormElement>(null);
  const [times, setTimes] = useState(0);
  useEffect(() => {
    if (times === 0) return;
    const field = form.current?.querySelector<HTMLElement>("[aria-invalid=true]");
    const said = form.current?.querySelector<HTMLElement>("[role=alert]");
    // A sentence that stands before any field, above the whole form say, is read first.
    const first = field && said && said.compareDocumentPosition(field) & Node.DOCUMENT_POSITION_PRECEDING ? field : (said ?? field);
    (first ?? field)?.scrollIntoView({ block: "center" });
    field?.focus({ preventScroll: true });
  }, [times]);
  return { form, tell: () => setTimes((before) => before + 1) };
}
