import { queryOptions } from "@tanstack/react-query";
import type { SystemDocument } from "@/shared/api/types";
import { LiveSocket } from "@/shared/live/liveSocket";
import type { Opened } from "@/shared/live/protocol";

/** What the service makes of a stored system: all parameters with value, unit and bounds; inputs, outputs. */
export const describedQuery = (id: string, revision: number) => queryOptions({ queryKey: ["described", id, revision], staleTime: Infinity, retry: false, queryFn: () => described(id) });

/** The same of a document that need not be stored. */
export const describedDocument = (document: SystemDocument) => queryOptions({ queryKey: ["described", JSON.stringify(document)], staleTime: Infinity, retry: false, queryFn: () => described(document) });

const described = (system: string | SystemDocument) => openedOnce({ system, samples: 2 });

/** What the live channel tells of a system that is opened once: nothing is drawn. */
export const openedOnce = (request: object) =>
  new Promise<Opened>((resolve, reject) => {
    const done = () => socket.close();
    const socket = new LiveSocket({
      onState: () => undefined,
      onOpened: (opened) => {
        done();
        resolve(opened);
      },
      onFrame: () => undefined,
      onMetrics: () => undefined,
      onProblem: (problem) => {
        done();
        reject(problem);
      },
    });
    socket.open(request);
  });
