import { useQuery } from "@tanstack/react-query";
import { useParams, useSearchParams } from "react-router";
import { methodsQuery, metricsQuery } from "@/shared/api/catalogue";
import { api, must } from "@/shared/api/client";
import { systemQuery } from "@/shared/api/systems";
import { describedQuery } from "@/shared/systems/described";
import { loopsOf } from "@/shared/systems/loops";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { firstOf, formAt } from "./address";
import { SearchForm } from "./SearchForm";

/** Design variables, goals and the method; the form is made from the catalogue. */
export function OptimisePage() {
  const { id = "" } = useParams();
  const system = useQuery(systemQuery(id)).data!;
  const described = useQuery(describedQuery(id, system.revision));
  const metrics = useQuery(metricsQuery).data;
  const methods = useQuery(methodsQuery).data;
  const signals = useQuery({ queryKey: ["catalogue", "signals"], staleTime: Infinity, gcTime: Infinity, queryFn: async () => (await must(api.GET("/v1/catalog/signals"))).items }).data;
  const [query] = useSearchParams();
  if (described.isError) return <ProblemAlert error={described.error} m="md" onRetry={() => void described.refetch()} />;
  if (!described.data || !metrics || !methods || !signals) return null;
  const loops = loopsOf(system.document);
  return <SearchForm key={system.revision} id={id} opened={described.data} loops={loops} metrics={metrics} methods={methods} signals={signals} given={formAt(id, query.get("f")) ?? firstOf(described.data, loops)} />;
}
