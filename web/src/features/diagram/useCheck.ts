import { useDebouncedValue } from "@mantine/hooks";
import { keepPreviousData, useQuery } from "@tanstack/react-query";
import { api, must } from "@/shared/api/client";
import { Problem } from "@/shared/api/problem";
import type { SystemDocument } from "@/shared/api/types";
import type { components } from "@/shared/api/schema";

const NONE: { pointer: string; detail: string }[] = [];

/** Lets the service look at the diagram whenever it has not changed for a moment: what is wrong, and what is only odd. */
export function useCheck(document: SystemDocument) {
  const [settled] = useDebouncedValue(document, 350);
  const port = Object.keys(settled.blocks).find((name) => settled.blocks[name]!.kind === "input");
  const check = useQuery({
    queryKey: ["check", JSON.stringify(settled)],
    enabled: port !== undefined && Object.keys(settled.outputs).length > 0,
    retry: false,
    gcTime: 10_000,
    placeholderData: keepPreviousData,
    queryFn: () =>
      must(api.POST("/v1/simulations", { body: { system: settled, input: { port, signal: { kind: "step" } }, samples: 2, metrics: [] } as unknown as components["schemas"]["SimulationRequest"] })),
  });
  const problem = check.error instanceof Problem && check.error.status === 422 ? check.error : null;
  return { problem, error: check.error && !problem ? check.error : null, warnings: check.data?.warnings ?? NONE, complete: port !== undefined && Object.keys(settled.outputs).length > 0, pending: settled !== document || check.isFetching };
}
