import { Badge, Button, Code, Group, List, Modal, Paper, ScrollArea, SimpleGrid, Stack, Text, Title } from "@mantine/core";
import { useDisclosure } from "@mantine/hooks";
import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useTranslation } from "react-i18next";
import { Link, useNavigate, useParams } from "react-router";
import { api, must } from "@/shared/api/client";
import { runsQuery, scheduleQuery } from "@/shared/api/schedules";
import { DataTable, NameLink } from "@/shared/ui/DataTable";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { When } from "@/shared/ui/When";
import { words } from "@/shared/units/format";
import { away, cronWords, zoned } from "./cron";

const SIGNS: Record<string, [string, string]> = { started: ["✓", "green"], waiting: ["…", "blue"], skipped: ["–", "gray"], missed: ["–", "orange"], refused: ["✗", "red"] };

/** A schedule: when in words and as a list, what it has done, and the buttons that stop it or start it now. */
export function SchedulePage() {
  const { t, i18n } = useTranslation();
  const { id = "" } = useParams();
  const navigate = useNavigate();
  const queries = useQueryClient();
  const schedule = useQuery(scheduleQuery(id));
  const runs = useQuery(runsQuery(id));
  const [asking, { open, close }] = useDisclosure();
  const path = { params: { path: { identifier: id } } };
  const act = useMutation({
    mutationFn: async (what: "pause" | "resume" | "trigger") => {
      if (what === "trigger") await must(api.POST("/v1/schedules/{identifier}/trigger", path));
      else if (what === "pause") await must(api.POST("/v1/schedules/{identifier}/pause", path));
      else await must(api.POST("/v1/schedules/{identifier}/resume", path));
    },
    onSuccess: () => Promise.all([queries.invalidateQueries({ queryKey: ["schedule", id] }), queries.invalidateQueries({ queryKey: ["schedules"] })]),
  });
  const remove = useMutation({
    mutationFn: (etag: string) => must(api.DELETE("/v1/schedules/{identifier}", { params: { path: { identifier: id }, header: { "If-Match": etag } } })),
    onSuccess: async () => {
      await navigate("/schedules");
      queries.removeQueries({ queryKey: ["schedule", id] });
      await queries.invalidateQueries({ queryKey: ["schedules"] });
    },
  });
  if (schedule.isError) return <ProblemAlert error={schedule.error} m="md" onRetry={() => void schedule.refetch()} />;
  if (!schedule.data) return null;
  const found = schedule.data;
  return (
    <div className="page">
      <PageHead title={found.name} doc={t(`jobs.kinds.${found.kind}`, words(found.kind))}>
        {found.paused && (
          <Badge variant="outline" color="orange" tt="none">
            {t("schedules.paused")}
          </Badge>
        )}
        <Button onClick={() => act.mutate("trigger")} loading={act.isPending}>
          {t("schedules.trigger")}
        </Button>
        <Button variant="default" onClick={() => act.mutate(found.paused ? "resume" : "pause")} loading={act.isPending}>
          {t(found.paused ? "schedules.resume" : "schedules.pause")}
        </Button>
        <Button variant="default" component={Link} to={`/schedules/${id}/edit`}>
          {t("schedules.edit")}
        </Button>
        <Button variant="subtle" color="red" onClick={open}>
          {t("systems.delete")}
        </Button>
      </PageHead>
      <Modal opened={asking} onClose={close} title={t("schedules.deleteTitle", { name: found.name })} closeButtonProps={{ "aria-label": t("datasets.close") }}>
        <Text fz="sm" mb="md">
          {t("schedules.deleteDoc")}
        </Text>
        <Button color="red" onClick={() => remove.mutate(found.etag)} loading={remove.isPending}>
          {t("systems.delete")}
        </Button>
      </Modal>
      <Stack gap="lg">
        <ProblemAlert error={act.error ?? remove.error ?? runs.error} />
        <SimpleGrid cols={{ base: 1, md: 2 }}>
          <Paper withBorder p="md" component="section">
            <Title order={2} mb="xs">
              {t("schedules.when")}
            </Title>
            <Text fw={600} data-testid="words">
              {cronWords(found.cron, i18n.language) ?? found.cron}
            </Text>
            <Text fz="xs" c="dimmed" mb="sm">
              <Code>{found.cron}</Code> · {found.time_zone}
            </Text>
            {found.next_runs.length === 0 ? (
              <Text fz="sm">{t("schedules.noRuns")}</Text>
            ) : (
              <List type="ordered" size="sm" data-testid="next">
                {found.next_runs.map((at) => (
                  <List.Item key={at}>
                    {zoned(at, found.time_zone, i18n.language)}
                    <Text span fz="xs" c="dimmed">
                      {" "}
                      · {away(at, Date.now(), i18n.language)}
                    </Text>
                  </List.Item>
                ))}
              </List>
            )}
            <Text fz="sm" mt="sm">
              {t(`schedules.overlaps.${found.document.overlap ?? "skip"}`)} {t(`schedules.misses.${found.document.missed ?? "one"}`)}
              {found.document.newest ? ` ${t("schedules.newestOf", { name: found.document.newest })}` : ""}
            </Text>
          </Paper>
          <Paper withBorder p="md" component="section" miw={0}>
            <Title order={2} mb="xs">
              {t("schedules.what")}
            </Title>
            <ScrollArea.Autosize mah={260} type="auto" viewportProps={{ tabIndex: 0, role: "group", "aria-label": t("schedules.what") }}>
              <Code block>{JSON.stringify(found.document.job.body, null, 2)}</Code>
            </ScrollArea.Autosize>
          </Paper>
        </SimpleGrid>
        <section>
          <Title order={2} mb="xs">
            {t("schedules.history")}
          </Title>
          {runs.data?.items.length === 0 && <Text fz="sm">{t("schedules.noHistory")}</Text>}
          {runs.data !== undefined && runs.data.items.length > 0 && (
            <DataTable
              testId="runs"
              rows={runs.data.items}
              keyOf={(run) => run.id}
              columns={[
                { title: t("schedules.due"), cell: (run) => <When at={run.due_at} /> },
                {
                  title: t("schedules.outcome"),
                  cell: (run) => (
                    <Group gap="xs">
                      <Badge variant="outline" color={SIGNS[run.outcome]?.[1] ?? "gray"} tt="none" leftSection={SIGNS[run.outcome]?.[0]}>
                        {t(`schedules.outcomes.${run.outcome}`)}
                      </Badge>
                      {run.detail && <Text fz="xs">{run.detail}</Text>}
                    </Group>
                  ),
                },
                { title: t("schedules.started"), cell: (run) => run.job && <NameLink to={`/jobs/${run.job}`}>{run.job}</NameLink> },
              ]}
            />
          )}
        </section>
      </Stack>
    </div>
  );
}
