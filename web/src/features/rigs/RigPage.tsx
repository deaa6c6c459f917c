import { Alert, Badge, Button, Group, Stack, Table, Text, Title } from "@mantine/core";
import { useInfiniteQuery, useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useTranslation } from "react-i18next";
import { Link, useParams } from "react-router";
import { api, must } from "@/shared/api/client";
import { DataTable } from "@/shared/ui/DataTable";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { When } from "@/shared/ui/When";
import { formatNumber, prettyUnit, withUnit } from "@/shared/units/format";
import { AcquisitionTable } from "./AcquisitionTable";
import { acquisitionsQuery, agentsQuery, calibrationState, presence, rigQuery, templatesQuery, type Calibration, type RigInput } from "./api";
import { FirstDay } from "./FirstDay";
import { Hardware } from "./Hardware";
import { delivered } from "./devices";
import { PresenceBadge } from "./PresenceBadge";

/** Kinds of inputs whose hardware is set to a range. */
const RANGED = new Set(["voltage", "acceleration", "force", "velocity", "bridge", "current"]);
const COLORS = { none: "gray", valid: "green", soon: "orange", overdue: "red" } as const;

/** A rig: its channels with their sensors and calibrations, what its outputs may do, and measurements that are ready to start. */
export function RigPage() {
  const { t } = useTranslation();
  const { id = "" } = useParams();
  const queries = useQueryClient();
  const rig = useQuery(rigQuery(id));
  const agents = useQuery(agentsQuery);
  const templates = useQuery(templatesQuery);
  const name = rig.data?.name ?? "";
  const acquisitions = useInfiniteQuery({ ...acquisitionsQuery({ rig: name }), enabled: name !== "" });
  const recorded = useInfiniteQuery({ ...acquisitionsQuery({ rig: name, status: "done" }), enabled: name !== "", refetchInterval: 30_000 });
  const remove = useMutation({
    mutationFn: ({ identifier, revision }: { identifier: string; revision: number }) => must(api.DELETE("/v1/acquisition-templates/{identifier}", { params: { path: { identifier }, header: { "If-Match": `"${revision}"` } } })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["acquisition-templates"] }),
  });
  if (rig.isError) return <ProblemAlert error={rig.error} m="md" onRetry={() => void rig.refetch()} />;
  if (!rig.data) return null;
  const { document } = rig.data;
  const agent = agents.data?.find((one) => one.id === rig.data.agent);
  const own = (templates.data ?? []).filter((template) => !template.document.rig || template.document.rig === name);
  const rows = acquisitions.data?.pages.flatMap((page) => page.items) ?? [];
  return (
    <div className="page">
      <PageHead title={name} doc={agent ? t("rigs.drivenBy", { name: agent.name }) : t("rigs.noAgent")}>
        <PresenceBadge state={agent ? presence(agent) : "away"} />
        <Button component={Link} to={`/rigs/${id}/measure`}>
          {t("rigs.measure")}
        </Button>
      </PageHead>
      <Stack gap="lg">
        <ProblemAlert error={remove.error ?? acquisitions.error ?? templates.error} />
        {agent && presence(agent) === "away" && (
          <Alert color="orange" variant="outline" role="status" data-testid="away">
            {t("rigs.seen")}: <When at={agent.seen_at} />
          </Alert>
        )}
        <FirstDay document={document} present={rig.data.present} recorded={(recorded.data?.pages[0]?.items.length ?? 0) > 0} />
        <Hardware document={document} />
        <section>
          <Title order={2} mb="xs">
            {t("rigs.inputs")}
          </Title>
          <Table.ScrollContainer minWidth={760}>
            <Table data-testid="inputs">
              <Table.Thead>
                <Table.Tr>
                  <Table.Th>{t("datasets.channel")}</Table.Th>
                  <Table.Th>{t("rigs.terminal")}</Table.Th>
                  <Table.Th>{t("rigs.sensor")}</Table.Th>
                  <Table.Th ta="right">{t("rigs.sensitivity")}</Table.Th>
                  <Table.Th ta="right">{t("rigs.range")}</Table.Th>
                  <Table.Th>{t("rigs.calibration")}</Table.Th>
                </Table.Tr>
              </Table.Thead>
              <Table.Tbody>{document.inputs?.map((input) => <Input key={input.name} input={input} />)}</Table.Tbody>
            </Table>
          </Table.ScrollContainer>
        </section>
        <section>
          <Title order={2} mb="xs">
            {t("rigs.outputs")}
          </Title>
          <DataTable
            testId="outputs"
            minWidth={640}
            rows={document.outputs ?? []}
            keyOf={(output) => output.name}
            columns={[
              { title: t("rigs.output"), strong: true, cell: (output) => output.name },
              { title: t("rigs.terminal"), cell: (output) => <span className="numbers">{output.channel}</span> },
              { title: t("rigs.amplitude"), numeric: true, cell: (output) => (output.kind === "digital" ? t("rigs.zeroOrOne") : `±${withUnit(output.amplitude, delivered(output))}`) },
              { title: t("rigs.slew"), numeric: true, cell: (output) => (output.slew == null ? "–" : `${formatNumber(output.slew)} ${delivered(output)}/s`) },
              { title: t("rigs.longest"), numeric: true, cell: (output) => (output.duration == null ? "–" : withUnit(output.duration, "s")) },
              { title: t("rigs.safe"), numeric: true, cell: (output) => withUnit(output.safe, delivered(output)) },
            ]}
          />
          <Text fz="xs" c="dimmed">
            {t("rigs.limitsDoc")}
          </Text>
        </section>
        <section>
          <Title order={2} mb="xs">
            {t("rigs.templates")}
          </Title>
          {own.length === 0 ? (
            <Text fz="sm">{t("rigs.noTemplates")}</Text>
          ) : (
            <Table maw={760} data-testid="templates">
              <Table.Tbody>
                {own.map((template) => (
                  <Table.Tr key={template.id}>
                    <Table.Td fw={500}>{template.name}</Table.Td>
                    <Table.Td>{(template.document.channels ?? []).join(", ")}</Table.Td>
                    <Table.Td ta="right">
                      <Group gap="xs" justify="flex-end">
                        <Button size="compact-xs" component={Link} to={`/rigs/${id}/measure?template=${template.id}`} aria-label={t("rigs.useOf", { name: template.name })}>
                          {t("rigs.use")}
                        </Button>
                        <Button size="compact-xs" variant="subtle" color="red" onClick={() => remove.mutate({ identifier: template.id, revision: template.revision })} aria-label={t("rigs.dropOf", { name: template.name })}>
                          {t("systems.delete")}
                        </Button>
                      </Group>
                    </Table.Td>
                  </Table.Tr>
                ))}
              </Table.Tbody>
            </Table>
          )}
        </section>
        {rows.length > 0 && (
          <section>
            <Title order={2} mb="xs">
              {t("rigs.measurements")}
            </Title>
            <AcquisitionTable rows={rows} />
          </section>
        )}
      </Stack>
    </div>
  );
}

function Input({ input }: { input: RigInput }) {
  const today = new Date().toISOString().slice(0, 10);
  const parts = [input, ...(input.chain ?? [])];
  return (
    <Table.Tr>
      <Table.Td fw={500}>{input.name}</Table.Td>
      <Table.Td className="numbers">{input.channel}</Table.Td>
      <Table.Td>
        {parts.map((part, i) => (
          <div key={i}>{[part.model, part.serial && `№ ${part.serial}`].filter(Boolean).join(", ") || "–"}</div>
        ))}
      </Table.Td>
      <Table.Td ta="right" className="numbers">
        {formatNumber(input.sensitivity)} {delivered(input) || "1"}/{prettyUnit(input.unit) || "1"}
        {input.chain?.map((stage, i) => <div key={i}>× {formatNumber(stage.gain)}</div>)}
      </Table.Td>
      <Table.Td ta="right" className="numbers">
        {RANGED.has(input.kind) ? `±${withUnit(input.range, delivered(input))}` : "–"}
      </Table.Td>
      <Table.Td>
        {parts.map((part, i) => (
          <Group key={i} gap="xs">
            <CalibrationBadge calibration={part.calibration} today={today} />
          </Group>
        ))}
      </Table.Td>
    </Table.Tr>
  );
}

function CalibrationBadge({ calibration, today }: { calibration: Calibration | undefined; today: string }) {
  const { t } = useTranslation();
  const state = calibrationState(calibration, today);
  return (
    <>
      <Badge variant="outline" color={COLORS[state]} tt="none">
        {t(`rigs.calibrations.${state}`)}
      </Badge>
      {calibration?.due && (
        <Text fz="xs">
          <When at={calibration.due} dateOnly />
          {calibration.certificate ? `, ${calibration.certificate}` : ""}
        </Text>
      )}
    </>
  );
}
