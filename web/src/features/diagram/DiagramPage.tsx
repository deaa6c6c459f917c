import { useQuery } from "@tanstack/react-query";
import { ReactFlowProvider } from "@xyflow/react";
import "@xyflow/react/dist/style.css";
import { useEffect, useState } from "react";
import { useParams } from "react-router";
import { elementsQuery } from "@/shared/api/catalogue";
import { systemQuery } from "@/shared/api/systems";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { keptDraft, keptPicture } from "./kept";
import { same } from "./merge";
import { useEditor } from "./store";
import { Workbench } from "./Workbench";

/** A system's diagram; what was edited here and never saved is there again. */
export function DiagramPage() {
  const { id = "" } = useParams();
  const system = useQuery(systemQuery(id)).data!;
  const elements = useQuery(elementsQuery);
  const [ready, setReady] = useState<{ id: string; since: string | null } | null>(null);
  const start = useEditor((s) => s.start);
  useEffect(() => {
    const draft = keptDraft(id);
    const own = draft && !same(draft.document, system.document) ? draft : null;
    if (own) start(own.document, own.base, own.etag, keptPicture(id));
    else start(system.document, system.document, system.etag, keptPicture(id));
    setReady({ id, since: own?.at ?? null });
    // What the service has later is no reason to throw away what is being edited: saving will tell.
  }, [id, start]);
  if (elements.isError) return <ProblemAlert error={elements.error} m="md" onRetry={() => void elements.refetch()} />;
  if (!elements.data || ready?.id !== id) return null;
  return (
    <ReactFlowProvider>
      <Workbench id={id} catalogue={elements.data} draftOf={ready.since} />
    </ReactFlowProvider>
  );
}
