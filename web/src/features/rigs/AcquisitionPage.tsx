import { Alert, Button, Code, Group, List, Modal, Paper, Progress, ScrollArea, Stack, Table, Text, Title, useComputedColorScheme } from "@mantine/core";
import { useDisclosure } from "@mantine/hooks";
import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useMemo } from "react";
import { useTranslation } from "react-i18next";
import { Link, useParams } from "react-router";
import { api, must } from "@/shared/api/client";
import { Problem } from "@/shared/api/problem";
import { writeFields } from "@/shared/forms/address";
import { Pairs } from "@/shared/plots/Pairs";
import { stroke } from "@/shared/plots/palette";
import { Plot } from "@/shared/plots/Plot";
import type { Curve, PlotSpec } from "@/shared/plots/types";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { StatusBadge } from "@/shared/ui/StatusBadge";
import { When } from "@/shared/ui/When";
import { prettyUnit, words } from "@/shared/units/format";
import { acquisitionQuery, rigsQuery, settled, type Acquisition, type AcquisitionRequest } from "./api";
import { upTo, useMeasurement, type Live } from "./live";
import { fieldsOf } from "./request";

/** What an agent says when it waits, and how the page says it. */
const WAITS: Record<string, string> = { "waits for the person at the rig": "rigs.waitsForPerson", "waits for the trigger": "rigs.waitsForTrigger", "live, nothing is recorded": "rigs.nothingRecorded" };

/** A measurement while it goes on: its samples as they come, its attempts, what follows it. */
export function AcquisitionPage() {
  const { t } = useTranslation();
  const { id = "" } = useParams();
  const queries = useQueryClient();
  const [asking, { open, close }] = useDisclosure();
  const measurement = useQuery(acquisitionQuery(id));
  const rigs = useQuery({ ...rigsQuery, refetchInterval: false });
  const over = measurement.data ? ["done", "failed", "lost", "cancelled"].includes(measurement.data.status) : false;
  const followed = useMeasurement(id, measurement.data?.attempt ?? 0, over && settled(measurement.data!));
  const path = { params: { path: { identifier: id } } };
  const act = useMutation({
    mutationFn: (what: "cancel" | "retry"): Promise<Acquisition> => must(what === "cancel" ? api.POST("/v1/acquisitions/{identifier}/cancel", path) : api.POST("/v1/acquisitions/{identifier}/retry", path)),
    onSuccess: (found) => {
      close();
      queries.setQueryData(["acquisition", id], found);
    },
  });
  if (measurement.isError) return <ProblemAlert error={measurement.error} m="md" onRetry={() => void measurement.refetch()} />;
  if (!measurement.data) return null;
  const found = measurement.data;
  const units = new Map(rigs.data?.find((one) => one.name === found.rig)?.document.inputs?.map((input) => [input.name, input.unit]));
  const last = found.attempts.at(-1);
  // Samples that are on their way have their place before they are there: nothing jumps.
  const asked = found.document as AcquisitionRequest;
  // What an output plays is not measured, and not shown while it goes on.
  const measured = (asked.channels ?? []).filter((name) => name !== asked.drive?.output || units.has(name));
  const awaited: Live = { time: [], channels: Object.fromEntries(measured.map((name) => [name, { low: [], high: [] }])) };
  const scope = found.document.record === false;
  const rig = rigs.data?.find((one) => one.name === found.rig);
  const drawn = followed.live !== null || (found.attempt > 0 && !followed.ended && !["failed", "lost", "cancelled"].includes(found.status));
  return (
    <div className="page">
      <PageHead title={found.name} doc={t("rigs.attemptOn", { rig: found.rig, number: found.attempt })}>
        <StatusBadge status={found.status} />
        {!over && (
          <Button variant="default" color="red" onClick={() => act.mutate("cancel")} loading={act.isPending}>
            {t("rigs.stop")}
          </Button>
        )}
        {scope && rig && (
          <Button variant="default" component={Link} to={{ pathname: `/rigs/${rig.id}/measure`, search: new URLSearchParams(written(found)).toString() }}>
            {t("rigs.toForm")}
          </Button>
        )}
        {["failed", "lost", "cancelled"].includes(found.status) && <Button onClick={open}>{t("rigs.retry")}</Button>}
        {found.dataset && (
          <Button component={Link} to={`/datasets/${found.dataset}`}>
            {t("rigs.recording")}
          </Button>
        )}
      </PageHead>
      <Modal opened={asking} onClose={close} title={t("rigs.retryTitle")} closeButtonProps={{ "aria-label": t("datasets.close") }}>
        <Stack gap="sm">
          <Text fz="sm">{t(found.status === "lost" ? "rigs.retryLost" : "rigs.retryDoc")}</Text>
          <Group>
            <Button onClick={() => act.mutate("retry")} loading={act.isPending}>
              {t("rigs.retryGo")}
            </Button>
            <Button variant="default" onClick={close}>
              {t("rigs.not")}
            </Button>
          </Group>
        </Stack>
      </Modal>
      <Stack gap="md">
        <ProblemAlert error={act.error} />
        <Remarks title={t("rigs.warnings")} color="orange" found={found.warnings.filter((warning) => warning.level !== "information")} />
        <Remarks title={t("rigs.remarks")} color="blue" found={found.warnings.filter((warning) => warning.level === "information")} />
        {last?.error && <ProblemAlert error={new Problem({ title: "", status: 0, detail: "", ...(last.error as object) })} />}
        {found.status === "lost" && (
          <Alert color="red" variant="outline" title={t("rigs.lostTitle")}>
            {t("rigs.lostDoc")}
          </Alert>
        )}
        {!over && (
          <section aria-live="polite">
            {!scope && <Progress value={100 * (followed.progress ?? 0)} size="lg" aria-label={t("jobs.progress")} animated />}
            <Text fz="sm" mt={4}>
              {WAITS[followed.message] ? t(WAITS[followed.message]!) : followed.message || t(`rigs.now.${found.status}`, "")}
            </Text>
          </section>
        )}
        {drawn && <LivePlots live={scope ? upTo(followed.live ?? awaited, fieldsOf(asked, []).duration) : (followed.live ?? awaited)} units={units} time={t(!scope ? "panel.time" : found.document.trigger ? "rigs.sinceTrigger" : "rigs.inSweep")} />}
        {last && last.then.length > 0 && (
          <section>
            <Title order={2} mb="xs">
              {t("rigs.then")}
            </Title>
            <Table maw={760} data-testid="then">
              <Table.Tbody>
                {last.then.map((step, i) => (
                  <Table.Tr key={i}>
                    <Table.Td>{t(`jobs.kinds.${step.kind}`, words(step.kind))}</Table.Td>
                    <Table.Td>{t(`rigs.steps.${step.status}`)}</Table.Td>
                    <Table.Td>{step.detail}</Table.Td>
                    <Table.Td>
                      {step.job && (
                        <Text component={Link} to={`/jobs/${step.job}`} c="var(--mantine-color-anchor)" fz="sm">
                          {t("jobs.result")}
                        </Text>
                      )}
                    </Table.Td>
                  </Table.Tr>
                ))}
              </Table.Tbody>
            </Table>
          </section>
        )}
        <section>
          <Title order={2} mb="xs">
            {t("rigs.attempts")}
          </Title>
          <Pairs>
            {[...found.attempts].reverse().map((attempt) => (
              <Paper key={attempt.number} withBorder p="sm" component="article" miw={0}>
                <Group justify="space-between">
                  <Title order={3}>{t("rigs.attempt", { number: attempt.number })}</Title>
                  <StatusBadge status={attempt.status} />
                </Group>
                <Text fz="xs" c="dimmed">
                  <When at={attempt.claimed_at} /> – <When at={attempt.ended_at} />
                  {attempt.late ? ` · ${t("rigs.late")}` : ""}
                </Text>
                {attempt.dataset && (
                  <Text component={Link} to={`/datasets/${attempt.dataset}`} c="var(--mantine-color-anchor)" fz="sm">
                    {t("rigs.recording")}
                  </Text>
                )}
                {attempt.facts && (
                  <ScrollArea.Autosize mah={320} mt="xs" type="auto" viewportProps={{ tabIndex: 0, role: "group", "aria-label": t("rigs.attempt", { number: attempt.number }) }}>
                    <Code block fz="xs">
                      {JSON.stringify(attempt.facts, rounded, 2)}
                    </Code>
                  </ScrollArea.Autosize>
                )}
              </Paper>
            ))}
          </Pairs>
        </section>
      </Stack>
    </div>
  );
}

/** The form of a measurement as this one was asked for, in the parameters of its address. */
function written(found: Acquisition): Record<string, string> {
  const { name, channels } = found.document as { name: string; channels: string[] };
  const fields = { ...fieldsOf(found.document as AcquisitionRequest, channels), name };
  return Object.fromEntries(Object.entries(writeFields(fields, fieldsOf(undefined, []))).filter((entry): entry is [string, string] => entry[1] !== null));
}

function Remarks({ title, color, found }: { title: string; color: string; found: Acquisition["warnings"] }) {
  if (found.length === 0) return null;
  return (
    <Alert color={color} variant="outline" title={title}>
      <List size="sm">
        {found.map((warning) => (
          <List.Item key={String(warning.detail)}>{String(warning.detail)}</List.Item>
        ))}
      </List>
    </Alert>
  );
}

/** Clocks and rates with the digits that mean something. */
const rounded = (_key: string, value: unknown): unknown => (typeof value === "number" ? Number(value.toPrecision(7)) : value);

function LivePlots({ live, units, time }: { live: Live; units: Map<string, string>; time: string }) {
  const names = Object.keys(live.channels);
  return (
    <Pairs data-testid="live" data-samples={live.time.length}>
      {names.map((name, i) => (
        <LivePlot key={name} name={name} unit={units.get(name) ?? ""} time={time} index={i} live={live} />
      ))}
    </Pairs>
  );
}

function LivePlot({ name, unit, time, index, live }: { name: string; unit: string; time: string; index: number; live: Live }) {
  const { t } = useTranslation();
  const dark = useComputedColorScheme("light") === "dark";
  const spec = useMemo<PlotSpec>(() => {
    const { color } = stroke(index, dark);
    const series = [
      { label: t("datasets.lowest"), color, dash: [] },
      { label: t("datasets.highest"), color, dash: [5, 2] },
    ];
    return { title: words(name), x: { label: time, unit: "s" }, y: { label: words(name), unit: prettyUnit(unit) }, series, dark };
  }, [name, unit, time, index, dark, t]);
  const curve = live.channels[name]!;
  const curves: Curve[] = [
    { x: live.time, y: curve.low },
    { x: live.time, y: curve.high },
  ];
  return <Plot spec={spec} curves={curves} height={220} summary={t("datasets.summary", { name, unit })} />;
}
