import { Button, Group, NativeSelect, Progress, Text } from "@mantine/core";
import { useInfiniteQuery } from "@tanstack/react-query";
import { useTranslation } from "react-i18next";
import { useSearchParams } from "react-router";
import { ENDED, jobsQuery } from "@/shared/api/jobs";
import { DataTable, NameLink } from "@/shared/ui/DataTable";
import { Empty } from "@/shared/ui/Empty";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { StatusBadge } from "@/shared/ui/StatusBadge";
import { When } from "@/shared/ui/When";
import { words } from "@/shared/units/format";

const KINDS = ["optimization", "identification", "validation", "import"];
const STATES = ["queued", "running", "succeeded", "failed", "cancelled"];

export function JobsPage() {
  const { t } = useTranslation();
  const [query, setQuery] = useSearchParams();
  const kind = query.get("kind") ?? "";
  const status = query.get("status") ?? "";
  const jobs = useInfiniteQuery(jobsQuery({ ...(kind ? { kind } : {}), ...(status ? { status } : {}) }));
  const rows = jobs.data?.pages.flatMap((page) => page.items) ?? [];
  const choose = (key: string, value: string) =>
    setQuery((before) => {
      const next = new URLSearchParams(before);
      if (value) next.set(key, value);
      else next.delete(key);
      return next;
    });
  return (
    <div className="page">
      <PageHead title={t("nav.jobs")} doc={t("jobs.doc")} />
      <ProblemAlert error={jobs.error} onRetry={() => void jobs.refetch()} />
      <Group mb="sm" align="flex-end">
        <NativeSelect size="xs" label={t("jobs.kind")} value={kind} onChange={(event) => choose("kind", event.currentTarget.value)} data={[{ value: "", label: t("jobs.all") }, ...KINDS.map((k) => ({ value: k, label: t(`jobs.kinds.${k}`, k) }))]} />
        <NativeSelect size="xs" label={t("jobs.status")} value={status} onChange={(event) => choose("status", event.currentTarget.value)} data={[{ value: "", label: t("jobs.all") }, ...STATES.map((s) => ({ value: s, label: t(`status.${s}`) }))]} />
      </Group>
      {jobs.isSuccess && rows.length === 0 && <Empty title={t("jobs.none")}>{t("jobs.noneDoc")}</Empty>}
      {rows.length > 0 && (
        <DataTable
          testId="jobs"
          highlight
          rows={rows}
          keyOf={(job) => job.id}
          columns={[
            { title: t("jobs.kind"), cell: (job) => <NameLink to={`/jobs/${job.id}`}>{t(`jobs.kinds.${job.kind}`, words(job.kind))}</NameLink> },
            { title: t("jobs.status"), cell: (job) => <StatusBadge status={job.status} /> },
            {
              title: t("jobs.progress"),
              width: 180,
              cell: (job) =>
                ENDED.has(job.status) ? (
                  <Text fz="xs" c="dimmed" lineClamp={1}>
                    {job.message}
                  </Text>
                ) : (
                  <Progress value={100 * job.progress} aria-label={t("jobs.progress")} />
                ),
            },
            { title: t("jobs.begun"), cell: (job) => <When at={job.created_at} /> },
            { title: t("jobs.ended"), cell: (job) => <When at={job.finished_at} /> },
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
