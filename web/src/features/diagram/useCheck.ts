import { useDebouncedValue } from "@mantine/hooks";
import { keepPreviousData, useQuery } from "@tanstack/react-query";
import { useMemo } from "react";
import { api, atOnce } from "@/shared/api/client";
import { Problem } from "@/shared/api/problem";
import type { SystemDocument } from "@/shared/api/types";
import type { components } from "@/shared/api/schema";

const NONE: { pointer: string; detail: string }[] = [];

export interface Check {
  /** What is wrong with the document. */
  problem: Problem | null;
  /** Why the service could not say. */
  error: Error | null;
  warnings: { pointer: string; detail: string }[];
  complete: boolean;
  pending: boolean;
}

/** Lets the service look at the diagram whenever it has not changed for a moment: what is wrong, and what is only odd. */
export function useCheck(document: SystemDocument): Check {
  const [settled] = useDebouncedValue(document, 350);
  const key = useMemo(() => JSON.stringify(settled), [settled]);
  const port = Object.keys(settled.blocks).find((name) => settled.blocks[name]!.kind === "input");
  const complete = port !== undefined && Object.keys(settled.outputs).length > 0;
  const check = useQuery({
    queryKey: ["check", key],
    enabled: complete,
    retry: false,
    gcTime: 10_000,
    placeholderData: keepPreviousData,
    // A service that does not answer is asked again until it does.
    refetchInterval: (query) => (query.state.error && !faulty(query.state.error) ? 2000 : false),
    queryFn: () =>
      atOnce(api.POST("/v1/simulations", { body: { system: settled, input: { port, signal: { kind: "step" } }, samples: 2, metrics: [] } as unknown as components["schemas"]["SimulationRequest"] })),
  });
  const problem = complete && faulty(check.error) ? check.error : null;
  return { problem, error: complete && !problem ? check.error : null, warnings: check.data?.warnings ?? NONE, complete, pending: settled !== document || check.isFetching };
}

function faulty(error: Error | null): error is Problem {
  return error instanceof Problem && error.status === 422;
}
