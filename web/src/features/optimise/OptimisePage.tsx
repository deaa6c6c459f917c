import { useQuery } from "@tanstack/react-query";
import { useMemo } from "react";
import { useTranslation } from "react-i18next";
import { useParams, useSearchParams } from "react-router";
import { methodsQuery, metricsQuery } from "@/shared/api/catalogue";
import { api, must } from "@/shared/api/client";
import { systemQuery } from "@/shared/api/systems";
import { describedQuery } from "@/shared/systems/described";
import { lastOf } from "@/shared/systems/last";
import { loopsOf } from "@/shared/systems/loops";
import { Busy } from "@/shared/ui/Busy";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { formAt } from "./address";
import { firstOf, useEffort } from "./first";
import { SearchForm } from "./SearchForm";

/** Design variables, goals and the method; the form is made from the catalogue. */
export function OptimisePage() {
  const { t } = useTranslation();
  const { id = "" } = useParams();
  const system = useQuery(systemQuery(id)).data!;
  const described = useQuery(describedQuery(id, system.revision));
  const metrics = useQuery(metricsQuery).data;
  const methods = useQuery(methodsQuery).data;
  const signals = useQuery({ queryKey: ["catalogue", "signals"], staleTime: Infinity, gcTime: Infinity, queryFn: async () => (await must(api.GET("/v1/catalog/signals"))).items }).data;
  const [query] = useSearchParams();
  const last = useMemo(() => lastOf(id)?.search, [id]);
  const given = formAt(id, query.get("f"));
  const { pending, effort } = useEffort(id, system.revision, described.data, system.document, last, given === null);
  if (described.isError) return <ProblemAlert error={described.error} m="md" onRetry={() => void described.refetch()} />;
  if (!described.data || !metrics || !methods || !signals) return null;
  if (pending) return <div className="page"><Busy>{t("optimise.preparing")}</Busy></div>;
  const loops = loopsOf(system.document);
  return <SearchForm key={system.revision} id={id} revision={system.revision} opened={described.data} loops={loops} metrics={metrics} methods={methods} signals={signals} effort={effort} given={given ?? firstOf(described.data, system.document, loops, last, effort)} />;
}
