import { Alert, Anchor, Button, Code, Group, List, Progress, ScrollArea, Stack, Text, Title } from "@mantine/core";
import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useTranslation } from "react-i18next";
import { Link, useParams } from "react-router";
import { api, must } from "@/shared/api/client";
import { ENDED, jobQuery, resultQuery } from "@/shared/api/jobs";
import { Problem } from "@/shared/api/problem";
import { systemQuery } from "@/shared/api/systems";
import { CommentsButton } from "@/shared/comments/CommentsButton";
import { download } from "@/shared/plots/export";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { ReportLinks } from "@/shared/ui/ReportLinks";
import { StatusBadge } from "@/shared/ui/StatusBadge";
import { words } from "@/shared/units/format";
import { useEvents } from "./events";
import { IdentificationView } from "./IdentificationView";
import { JobClock } from "./JobClock";
import { BestSoFar } from "./optimization/BestSoFar";
import { Convergence } from "./optimization/Convergence";
import { OptimizationView } from "./optimization/OptimizationView";
import { isIdentification, isOptimization, isValidation } from "./results";
import { ValidationView } from "./ValidationView";

export function JobPage() {
  const { t } = useTranslation();
  const { id = "" } = useParams();
  const queries = useQueryClient();
  const job = useQuery(jobQuery(id));
  const running = job.data !== undefined && !ENDED.has(job.data.status);
  const followed = useEvents(id, running);
  const found = job.data?.status === "succeeded" || (job.data?.status === "cancelled" && job.data.result !== null);
  const result = useQuery({ ...resultQuery(id), enabled: found });
  const of = useQuery({ ...systemQuery(job.data?.system?.id ?? ""), enabled: job.data?.system != null, retry: false });
  const cancel = useMutation({
    mutationFn: () => must(api.POST("/v1/jobs/{identifier}/cancel", { params: { path: { identifier: id } } })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["job", id] }),
  });
  if (job.isError) return <ProblemAlert error={job.error} m="md" onRetry={() => void job.refetch()} />;
  // Without the name of its system, whose length is not known, what is below the head would move when that comes.
  if (!job.data || of.isLoading) return null;
  const { kind, status, system } = job.data;
  const best = followed.best.at(-1);
  return (
    <div className="page">
      <PageHead title={t(`jobs.kinds.${kind}`, words(kind))} doc={
          <>
            {system && (
              <>
                <Anchor component={Link} to={`/systems/${system.id}/panel`} data-testid="of-system">
                  {of.data?.document.name || system.id}
                </Anchor>{" "}
                · {t("system.revision", { number: system.revision })} ·{" "}
              </>
            )}
            <span className="numbers">{id}</span>
          </>
        }
      >
        <StatusBadge status={status} />
        <CommentsButton key={id} about={id} />
        {running && (
          <Button variant="default" color="red" onClick={() => cancel.mutate()} loading={cancel.isPending}>
            {t("jobs.cancel")}
          </Button>
        )}
        {/* What is done with a result stands there before that has come: buttons that come later would push the others aside. */}
        {found && (
          <Button variant="default" disabled={result.data === undefined} onClick={() => download(`${id}.json`, new Blob([JSON.stringify(result.data, null, 2)], { type: "application/json" }))}>
            {t("jobs.download")}
          </Button>
        )}
        <Button variant="default" component={Link} to={`/lineage/${id}`}>
          {t("lineage.open")}
        </Button>
        {found && <ReportLinks of={`/v1/jobs/${id}`} kind={kind} />}
        {kind === "optimization" && (
          <Button variant="default" component="a" href={`/v1/jobs/${id}/script`} download>
            {t("jobs.script")}
          </Button>
        )}
      </PageHead>
      <Stack gap="md">
        <ProblemAlert error={cancel.error ?? result.error} />
        {job.data.error && <ProblemAlert error={new Problem({ title: "", status: 0, detail: "", ...(job.data.error as object) })} />}
        {running && job.data.warnings.length > 0 && (
          <Alert color="orange" variant="outline" title={t("jobs.warned")} data-testid="warned">
            <List size="sm">
              {job.data.warnings.map(({ detail }) => (
                <List.Item key={detail}>{detail}</List.Item>
              ))}
            </List>
          </Alert>
        )}
        {running && (
          <section aria-live="polite">
            {job.data.started_at && <JobClock since={job.data.started_at} share={followed.progress ?? job.data.progress} />}
            <Progress value={100 * (followed.progress ?? job.data.progress)} size="lg" aria-label={t("jobs.progress")} animated />
            <Text fz="sm" mt={4} className="numbers">
              {followed.messages.at(-1) ?? job.data.message}
            </Text>
          </section>
        )}
        {running && kind === "optimization" && system && best?.values && <BestSoFar job={id} system={system} values={best.values} />}
        {running && followed.best.length > 1 && <Convergence points={followed.best} />}
        {result.data !== undefined &&
          (isOptimization(kind, result.data) ? (
            <OptimizationView id={id} result={result.data} />
          ) : isIdentification(kind, result.data) ? (
            <IdentificationView id={id} result={result.data} />
          ) : isValidation(kind, result.data) ? (
            <ValidationView result={result.data} />
          ) : (
            <section>
              <Title order={2} mb="xs">
                {t("jobs.result")}
              </Title>
              <ScrollArea.Autosize mah={480} type="auto" viewportProps={{ tabIndex: 0, role: "group", "aria-label": t("jobs.result") }}>
                <Code block>{JSON.stringify(result.data, null, 2).slice(0, 20_000)}</Code>
              </ScrollArea.Autosize>
            </section>
          ))}
        {running && followed.messages.length > 0 && (
          <Group>
            <Text fz="xs" c="dimmed" component="pre" className="numbers" style={{ whiteSpace: "pre-wrap" }}>
              {followed.messages.slice(-8).join("\n")}
            </Text>
          </Group>
        )}
      </Stack>
    </div>
  );
}
