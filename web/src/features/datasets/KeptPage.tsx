import { Anchor, Button, Code, ScrollArea, Stack } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useTranslation } from "react-i18next";
import { Link, useParams } from "react-router";
import { api, must } from "@/shared/api/client";
import type { components } from "@/shared/api/schema";
import { systemQuery } from "@/shared/api/systems";
import { AnalysisChart } from "@/shared/charts/AnalysisChart";
import { CommentsButton } from "@/shared/comments/CommentsButton";
import { download } from "@/shared/plots/export";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { ReportLinks } from "@/shared/ui/ReportLinks";
import { When } from "@/shared/ui/When";
import { words } from "@/shared/units/format";
import { Spectrum } from "./DatasetPage";
import { FrfResult } from "./FrfPage";
import { describedQuery } from "@/shared/systems/described";
import { curvesOf } from "./kept";

type Kept = components["schemas"]["KeptResult"];

/** A result that was asked to be kept, by its address: what it is of, what came out, and what was said of it. */
export function KeptPage() {
  const { t } = useTranslation();
  const { id = "" } = useParams();
  const kept = useQuery({ queryKey: ["result", id], staleTime: Infinity, queryFn: () => must(api.GET("/v1/results/{identifier}", { params: { path: { identifier: id } } })) });
  const of = useQuery({ ...systemQuery(kept.data?.system?.id ?? ""), enabled: kept.data?.system != null, retry: false });
  if (kept.isError) return <ProblemAlert error={kept.error} m="md" onRetry={() => void kept.refetch()} />;
  // Without the name of its system, whose length is not known, what is below the head would move when that comes.
  if (!kept.data || of.isLoading) return null;
  const { kind, created_at, system, request } = kept.data;
  const dataset = typeof request?.dataset === "string" ? request.dataset : null;
  return (
    <div className="page">
      <PageHead
        title={t(`jobs.kinds.${kind}`, words(kind))}
        doc={
          <>
            {system && (
              <>
                <Anchor component={Link} to={`/systems/${system.id}/panel`} inherit underline="always">
                  {of.data?.document.name || system.id}
                </Anchor>{" "}
                · {t("system.revision", { number: system.revision })} ·{" "}
              </>
            )}
            {dataset && (
              <>
                <Anchor component={Link} to={`/datasets/${dataset}`} inherit underline="always">
                  {t("spectra.toRecording")}
                </Anchor>{" "}
                ·{" "}
              </>
            )}
            <When at={created_at} /> · <span className="numbers">{id}</span>
          </>
        }
      >
        <CommentsButton key={id} about={id} />
        <Button variant="default" onClick={() => download(`${id}.json`, new Blob([JSON.stringify(kept.data, null, 2)], { type: "application/json" }))}>
          {t("jobs.download")}
        </Button>
        <ReportLinks of={`/v1/results/${id}`} kind={kind} />
        <Button variant="default" component={Link} to={`/lineage/${id}`}>
          {t("lineage.open")}
        </Button>
      </PageHead>
      <Stack gap="md" data-testid="kept">
        <Body kept={kept.data} />
      </Stack>
    </div>
  );
}

/** What came out, drawn where it has curves, else as it is. */
function Body({ kept: { id, kind, request, result, system } }: { kept: Kept }) {
  const { t } = useTranslation();
  // The units of outputs are those of the diagram, which a reply without metrics does not tell.
  const described = useQuery({ ...describedQuery(system?.id ?? "", system?.revision ?? 0), enabled: system != null && kind === "simulation" }).data;
  const units = new Map(described?.outputs.map(({ name, unit }) => [name, unit]));
  const asked = request ?? {};
  if (kind === "frf") return <FrfResult reply={result as components["schemas"]["FrfReply"]} body={asked} kept={id} />;
  if (kind === "spectrum") return <Spectrum name={String(asked.channel ?? asked.output ?? "")} reply={result as components["schemas"]["SpectrumReply"]} />;
  const charts = curvesOf(kind, result, t, units);
  if (charts.length > 0) return charts.map((spec) => <AnalysisChart key={spec.title} spec={spec} height={300} summary={spec.title} />);
  return (
    <ScrollArea.Autosize mah={480} type="auto" viewportProps={{ tabIndex: 0, role: "group", "aria-label": t("jobs.result") }}>
      <Code block>{JSON.stringify(result, null, 2).slice(0, 20_000)}</Code>
    </ScrollArea.Autosize>
  );
}
