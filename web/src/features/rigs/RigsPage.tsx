import { Badge, Button, Card, Code, Group, NativeSelect, SimpleGrid, Stack, Text, Title } from "@mantine/core";
import { keepPreviousData, useInfiniteQuery, useQuery } from "@tanstack/react-query";
import { useTranslation } from "react-i18next";
import { Link, useSearchParams } from "react-router";
import { DataTable } from "@/shared/ui/DataTable";
import { Empty } from "@/shared/ui/Empty";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { When } from "@/shared/ui/When";
import { AcquisitionTable } from "./AcquisitionTable";
import { acquisitionsQuery, agentsQuery, calibrationState, presence, rigsQuery, type AcquisitionStatus, type Rig } from "./api";
import { PresenceBadge } from "./PresenceBadge";

const STATES: AcquisitionStatus[] = ["queued", "claimed", "running", "uploading", "done", "failed", "lost", "cancelled"];

/** The rigs of the laboratory, the agents that drive them, and what was measured. */
export function RigsPage() {
  const { t } = useTranslation();
  const [query, setQuery] = useSearchParams();
  const status = STATES.find((state) => state === query.get("status"));
  const rigs = useQuery(rigsQuery);
  const agents = useQuery(agentsQuery);
  const acquisitions = useInfiniteQuery({ ...acquisitionsQuery(status ? { status } : {}), placeholderData: keepPreviousData });
  const rows = acquisitions.data?.pages.flatMap((page) => page.items) ?? [];
  // Everything at once: what comes later would push down what is there.
  const there = !rigs.isPending && !agents.isPending && !acquisitions.isPending;
  return (
    <div className="page">
      <PageHead title={t("nav.rigs")} doc={t("rigs.doc")} />
      <Stack gap="lg" display={there ? undefined : "none"}>
        <ProblemAlert error={rigs.error ?? agents.error ?? acquisitions.error} />
        {rigs.data?.length === 0 && (
          <Empty
            title={t("rigs.none")}
            action={
              <Button component={Link} to="/access">
                {t("rigs.toAccess")}
              </Button>
            }
          >
            {t("rigs.noneDoc")}
            <Code block mt="sm">
              {"pip install 'servotune-agent[nidaqmx]'\nexport SERVOTUNE_AGENT_KEY=...\nservotune agent --settings agent.toml"}
            </Code>
          </Empty>
        )}
        <SimpleGrid cols={{ base: 1, sm: 2, lg: 3 }}>{rigs.data?.map((rig) => <RigCard key={rig.id} rig={rig} agent={agents.data?.find((one) => one.id === rig.agent)} />)}</SimpleGrid>
        {agents.data !== undefined && agents.data.length > 0 && (
          <section>
            <Title order={2} mb="xs">
              {t("rigs.agents")}
            </Title>
            <DataTable
              testId="agents"
              rows={agents.data}
              keyOf={(agent) => agent.id}
              columns={[
                { title: t("systems.name"), cell: (agent) => agent.name },
                { title: t("rigs.rig"), cell: (agent) => agent.rig },
                { title: t("jobs.status"), cell: (agent) => <PresenceBadge state={presence(agent)} /> },
                { title: t("rigs.seen"), cell: (agent) => <When at={agent.seen_at} /> },
                { title: t("about.version"), cell: (agent) => <span className="numbers">{agent.version}</span> },
              ]}
            />
          </section>
        )}
        {(rows.length > 0 || status) && (
          <section>
            <Group justify="space-between" mb="xs" align="flex-end">
              <Title order={2}>{t("rigs.measurements")}</Title>
              <NativeSelect size="xs" label={t("jobs.status")} value={status ?? ""} onChange={(event) => setQuery(event.currentTarget.value ? { status: event.currentTarget.value } : {}, { replace: true, preventScrollReset: true })} data={[{ value: "", label: t("jobs.all") }, ...STATES.map((state) => ({ value: state, label: t(`status.${state}`) }))]} />
            </Group>
            {rows.length === 0 ? <Text fz="sm">{t("rigs.noMatch")}</Text> : <AcquisitionTable rows={rows} />}
            {acquisitions.hasNextPage && (
              <Button variant="default" onClick={() => void acquisitions.fetchNextPage()}>
                {t("systems.further")}
              </Button>
            )}
          </section>
        )}
      </Stack>
    </div>
  );
}

function RigCard({ rig, agent }: { rig: Rig; agent: Parameters<typeof presence>[0] | undefined }) {
  const { t } = useTranslation();
  const today = new Date().toISOString().slice(0, 10);
  const overdue = (rig.document.inputs ?? []).filter((input) => calibrationState(input.calibration, today) === "overdue");
  const failing = (rig.document.findings ?? []).filter((finding) => finding.result === "fails").length;
  return (
    <Card withBorder padding="md" component="article">
      <Group justify="space-between" mb={4}>
        <Title order={2}>
          <Text component={Link} to={`/rigs/${rig.id}`} inherit c="var(--mantine-color-anchor)">
            {rig.name}
          </Text>
        </Title>
        <PresenceBadge state={agent ? presence(agent) : "away"} />
      </Group>
      <Text fz="sm" c="dimmed">
        {t("rigs.inputCount", { count: rig.document.inputs?.length ?? 0 })}, {t("rigs.outputCount", { count: rig.document.outputs?.length ?? 0 })}
      </Text>
      <Text fz="sm" c="dimmed">
        {(rig.document.devices ?? []).map((device) => device.model || device.name).join(", ")}
      </Text>
      {failing > 0 && (
        <Badge mt={6} mr={6} variant="outline" color="red" tt="none">
          {t("rigs.findings.fails", { count: failing })}
        </Badge>
      )}
      {overdue.length > 0 && (
        <Badge mt={6} variant="outline" color="orange" tt="none">
          {t("rigs.overdueOf", { names: overdue.map((input) => input.name).join(", ") })}
        </Badge>
      )}
      <Group mt="sm">
        <Button component={Link} to={`/rigs/${rig.id}/measure`}>
          {t("rigs.measure")}
        </Button>
        <Button variant="default" component={Link} to={`/rigs/${rig.id}`} aria-label={t("rigs.openOf", { name: rig.name })}>
          {t("systems.open")}
        </Button>
      </Group>
    </Card>
  );
}
