import { Button, Checkbox, Group, NativeSelect, Progress, Text, VisuallyHidden } from "@mantine/core";
import { useInfiniteQuery, useMutation, useQueryClient } from "@tanstack/react-query";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { Link } from "react-router";
import { api, must } from "@/shared/api/client";
import { ENDED, jobsQuery } from "@/shared/api/jobs";
import type { JobReply } from "@/shared/api/types";
import { compareAt, MOST_DESIGNS } from "@/shared/systems/compared";
import { DataTable, NameLink } from "@/shared/ui/DataTable";
import { Empty } from "@/shared/ui/Empty";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { StatusBadge } from "@/shared/ui/StatusBadge";
import { When } from "@/shared/ui/When";
import { withUnit, words } from "@/shared/units/format";
import { useQueryText } from "@/shared/ui/useQueryText";

const KINDS = ["optimization", "identification", "validation", "import", "preview", "processing", "average", "acquisition"];
const STATES = ["queued", "running", "succeeded", "failed", "cancelled"];

/** A search that has found something, which can be compared with others. */
const isDesign = (job: JobReply) => (job.kind === "optimization" || job.kind === "identification") && job.result !== null;

export function JobsPage() {
  const { t } = useTranslation();
  const [query, setQuery] = useQueryText();
  const [chosen, setChosen] = useState<string[]>([]);
  const kind = query.get("kind") ?? "";
  const status = query.get("status") ?? "";
  const jobs = useInfiniteQuery(jobsQuery({ ...(kind ? { kind } : {}), ...(status ? { status } : {}) }));
  const queries = useQueryClient();
  const cancel = useMutation({
    mutationFn: (id: string) => must(api.POST("/v1/jobs/{identifier}/cancel", { params: { path: { identifier: id } } })),
    onSettled: () => queries.invalidateQueries({ queryKey: ["jobs"] }),
  });
  const rows = jobs.data?.pages.flatMap((page) => page.items) ?? [];
  const choose = (key: string, value: string) =>
    setQuery((next) => {
      if (value) next.set(key, value);
      else next.delete(key);
      return next;
    }, {});
  return (
    <div className="page">
      <PageHead title={t("nav.jobs")} doc={t("jobs.doc")} />
      <ProblemAlert error={jobs.error} onRetry={() => void jobs.refetch()} />
      <ProblemAlert error={cancel.error} />
      <Group mb="sm" align="flex-end">
        <NativeSelect size="xs" label={t("jobs.kind")} value={kind} onChange={(event) => choose("kind", event.currentTarget.value)} data={[{ value: "", label: t("jobs.all") }, ...KINDS.map((k) => ({ value: k, label: t(`jobs.kinds.${k}`, k) }))]} />
        <NativeSelect size="xs" label={t("jobs.status")} value={status} onChange={(event) => choose("status", event.currentTarget.value)} data={[{ value: "", label: t("jobs.all") }, ...STATES.map((s) => ({ value: s, label: t(`status.${s}`) }))]} />
        {rows.some(isDesign) && (
          <Button component={Link} to={compareAt(chosen.map((id) => ({ kind: "job", id })))} variant="default">
            {t("compare.chosen", { count: chosen.length })}
          </Button>
        )}
      </Group>
      {jobs.isSuccess && rows.length === 0 && (kind || status ? (
          <Empty title={t("jobs.noneSuch")} action={<Button onClick={() => setQuery(() => new URLSearchParams(), {})}>{t("jobs.showAll")}</Button>}>
            {t("jobs.noneSuchDoc")}
          </Empty>
        ) : (
          <Empty
            title={t("jobs.none")}
            action={
              <Button component={Link} to="/systems">
                {t("jobs.toSystems")}
              </Button>
            }
          >
            {t("jobs.noneDoc")}
          </Empty>
        ))}
      {rows.length > 0 && (
        <DataTable
          testId="jobs"
          highlight
          rows={rows}
          keyOf={(job) => job.id}
          columns={[
            ...(rows.some(isDesign)
              ? [
                  {
                    title: <VisuallyHidden>{t("compare.choose")}</VisuallyHidden>,
                    width: 40,
                    cell: (job: JobReply) =>
                      isDesign(job) && (
                        <Checkbox size="xs" aria-label={t("compare.chooseOne", { name: job.id })} checked={chosen.includes(job.id)} disabled={chosen.length >= MOST_DESIGNS && !chosen.includes(job.id)} onChange={(event) => setChosen(event.currentTarget.checked ? [...chosen, job.id] : chosen.filter((id) => id !== job.id))} />
                      ),
                  },
                ]
              : []),
            { title: t("jobs.kind"), cell: (job) => <NameLink to={`/jobs/${job.id}`}>{t(`jobs.kinds.${job.kind}`, words(job.kind))}</NameLink> },
            { title: t("jobs.status"), cell: (job) => <StatusBadge status={job.status} /> },
            {
              title: t("jobs.progress"),
              width: 180,
              cell: (job) =>
                ENDED.has(job.status) ? (
                  <Text fz="xs" c="dimmed" lineClamp={1}>
                    {job.status === "succeeded" ? t("jobs.took", { time: withUnit((Date.parse(job.finished_at ?? "") - Date.parse(job.started_at ?? "")) / 1000, "s", 3) }) : job.message}
                  </Text>
                ) : (
                  <Progress value={100 * job.progress} aria-label={t("jobs.progress")} />
                ),
            },
            { title: t("jobs.begun"), cell: (job) => <When at={job.created_at} /> },
            { title: t("jobs.ended"), cell: (job) => <When at={job.finished_at} /> },
            {
              title: "",
              cell: (job) =>
                job.status === "succeeded" ? (
                  <Button variant="subtle" size="compact-xs" component="a" href={`/v1/jobs/${job.id}/result`} download={`${job.id}.json`} aria-label={t("jobs.downloadOf", { id: job.id })}>
                    {t("jobs.download")}
                  </Button>
                ) : ENDED.has(job.status) ? null : (
                  <Button variant="subtle" size="compact-xs" color="red" onClick={() => cancel.mutate(job.id)} loading={cancel.isPending && cancel.variables === job.id} aria-label={t("jobs.cancelOf", { id: job.id })}>
                    {t("jobs.cancel")}
                  </Button>
                ),
            },
          ]}
        />
      )}
      {jobs.hasNextPage && (
        <Button variant="default" onClick={() => void jobs.fetchNextPage()}>
          {t("systems.further")}
        </Button>
      )}
    </div>
  );
}
