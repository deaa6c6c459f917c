import { Badge, Button, Code, Text } from "@mantine/core";
import { useInfiniteQuery } from "@tanstack/react-query";
import { useTranslation } from "react-i18next";
import { Link } from "react-router";
import { schedulesQuery } from "@/shared/api/schedules";
import { DataTable, NameLink } from "@/shared/ui/DataTable";
import { Empty } from "@/shared/ui/Empty";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { words } from "@/shared/units/format";
import { away, cronWords, zoned } from "./cron";

/** What runs by itself, when in words, and when next. */
export function SchedulesPage() {
  const { t, i18n } = useTranslation();
  const schedules = useInfiniteQuery(schedulesQuery);
  const rows = schedules.data?.pages.flatMap((page) => page.items) ?? [];
  return (
    <div className="page">
      <PageHead title={t("nav.schedules")} doc={t("schedules.doc")}>
        <Button component={Link} to="/schedules/new">
          {t("schedules.new")}
        </Button>
      </PageHead>
      <ProblemAlert error={schedules.error} onRetry={() => void schedules.refetch()} />
      {schedules.isSuccess && rows.length === 0 && (
        <Empty
          title={t("schedules.none")}
          action={
            <Button component={Link} to="/schedules/new">
              {t("schedules.new")}
            </Button>
          }
        >
          {t("schedules.noneDoc")}
        </Empty>
      )}
      {rows.length > 0 && (
        <DataTable
          testId="schedules"
          minWidth={720}
          highlight
          rows={rows}
          keyOf={(row) => row.id}
          columns={[
            { title: t("systems.name"), cell: (row) => <NameLink to={`/schedules/${row.id}`}>{row.name}</NameLink> },
            { title: t("schedules.what"), cell: (row) => t(`jobs.kinds.${row.kind}`, words(row.kind)) },
            {
              title: t("schedules.when"),
              cell: (row) => (
                <>
                  {cronWords(row.cron, i18n.language) ?? <Code>{row.cron}</Code>}
                  <Text fz="xs" c="dimmed">
                    {row.time_zone}
                  </Text>
                </>
              ),
            },
            {
              title: t("schedules.next"),
              cell: (row) =>
                row.paused || !row.next_at ? (
                  <Badge variant="outline" color="orange" tt="none">
                    {t("schedules.paused")}
                  </Badge>
                ) : (
                  <>
                    {away(row.next_at, Date.now(), i18n.language)}
                    <Text fz="xs" c="dimmed">
                      {zoned(row.next_at, row.time_zone, i18n.language)}
                    </Text>
                  </>
                ),
            },
          ]}
        />
      )}
      {schedules.hasNextPage && (
        <Button variant="default" onClick={() => void schedules.fetchNextPage()}>
          {t("systems.further")}
        </Button>
      )}
    </div>
  );
}
