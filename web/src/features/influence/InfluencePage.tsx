import { Alert, Group, MultiSelect, NativeSelect, SegmentedControl, Slider, Stack, Table, Text, Title, UnstyledButton } from "@mantine/core";
import { keepPreviousData, useQuery } from "@tanstack/react-query";
import { Fragment, useEffect, useState } from "react";
import { useTranslation } from "react-i18next";
import { Link, useParams } from "react-router";
import { metricsQuery } from "@/shared/api/catalogue";
import { api, atOnce } from "@/shared/api/client";
import { systemQuery } from "@/shared/api/systems";
import { describedQuery } from "@/shared/systems/described";
import { loopsOf } from "@/shared/systems/loops";
import { firstSliders } from "@/shared/systems/movable";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { MetricValue } from "@/shared/ui/MetricValue";
import { formatNumber, words } from "@/shared/units/format";
import { useQueryText } from "@/shared/ui/useQueryText";
import classes from "./InfluencePage.module.css";
import { barsOf, beyondRounding, changeIn, columnIn, sizeOf } from "./table";

/** Many pills scroll within two lines: the table is what the page is for. */
const COMPACT = { classNames: { input: classes.many! } };
const FIRST = ["rise_time", "response_time", "overshoot", "bandwidth", "phase_margin", "sensitivity_peak", "damping_ratio"];

/** Which parameter moves which property, and how much: a table to be read by rows and by columns, and a tornado of each row and each column. */
export function InfluencePage() {
  const { t } = useTranslation();
  const { id = "" } = useParams();
  const system = useQuery(systemQuery(id)).data!;
  const described = useQuery(describedQuery(id, system.revision));
  const catalogue = useQuery(metricsQuery).data;
  const [query, setQuery] = useQueryText();
  const put = (part: Record<string, string>) => setQuery((before) => new URLSearchParams({ ...Object.fromEntries(before), ...part }));
  const opened = described.data;
  const loops = loopsOf(system.document);
  const list = (key: string, fallback: string[]) => (query.has(key) ? query.get(key)!.split(",").filter(Boolean) : fallback);
  const input = query.get("in") ?? opened?.inputs[0] ?? "";
  const output = query.get("out") ?? opened?.outputs[0]?.name ?? "";
  const loop = query.get("loop") ?? loops[0] ?? "";
  const parameters = list("p", opened ? firstSliders(opened.parameters, 8) : []);
  const metrics = list("m", FIRST.filter((name) => loop || catalogue?.get(name)?.domain !== "loop"));
  const change = changeIn(query.get("change"));
  const kind = query.get("kind") === "coefficient" ? "coefficient" : "elasticity";
  const [shownChange, setShownChange] = useState(change);
  useEffect(() => setShownChange(change), [change]);
  const study = useQuery({
    queryKey: ["influence", id, system.revision, input, output, loop, parameters.join(), metrics.join(), change],
    enabled: opened !== undefined && catalogue !== undefined && parameters.length > 0 && metrics.length > 0 && input !== "",
    retry: false,
    placeholderData: keepPreviousData,
    queryFn: () => atOnce(api.POST("/v1/influence", { body: { system: id, input, output, ...(loop ? { open_at: loop } : {}), parameters, metrics, change: change / 100, duration: "auto", keep: false } })),
  });
  const chosen = metrics.find((metric) => metric === query.get("row")) ?? metrics[0] ?? "";
  const value = (metric: string, parameter: string): number | null => {
    const cell = kind === "elasticity" ? study.data?.elasticities[metric]?.[parameter] : study.data?.coefficients[metric]?.[parameter];
    const found = (cell?.value as number | null | undefined) ?? null;
    return found === null ? null : beyondRounding(found);
  };
  const largest = Math.max(1e-12, ...metrics.flatMap((m) => parameters.map((p) => Math.abs(value(m, p) ?? 0))).filter(Number.isFinite));
  const column = columnIn(query.get("col"), parameters);
  const bars = barsOf(value, { metrics, parameters, row: chosen, column });
  const metricName = (metric: string) => t(`metrics.${metric}`, words(metric));
  const heading = column === null ? t("influence.tornado", { metric: metricName(chosen) }) : t("influence.columnTornado", { parameter: column });
  const widest = Math.max(1e-12, ...bars.map((bar) => Math.abs(bar.value)));
  const panelOf = (parameter: string) => `/systems/${id}/panel?s=${encodeURIComponent([parameter, ...parameters.filter((p) => p !== parameter)].join(","))}${loop ? `&loop=${loop}` : ""}`;

  return (
    <div className="page">
      <Stack gap="md">
        <ProblemAlert error={described.error ?? study.error} />
        {opened && catalogue && (
          <>
            <Group align="flex-start" gap="sm">
              <NativeSelect size="xs" label={t("panel.input")} data={opened.inputs} value={input} onChange={(event) => put({ in: event.currentTarget.value })} />
              <NativeSelect size="xs" label={t("panel.output")} data={opened.outputs.map((o) => ({ value: o.name, label: words(o.name) }))} value={output} onChange={(event) => put({ out: event.currentTarget.value })} />
              <NativeSelect size="xs" label={t("influence.loop")} data={[{ value: "", label: t("influence.noLoop") }, ...loops]} value={loop} onChange={(event) => put({ loop: event.currentTarget.value })} />
              <MultiSelect label={t("panel.parameters")} data={opened.parameters.filter((p) => !p.bound).map((p) => p.path)} value={parameters} onChange={(next) => put({ p: next.join(",") })} searchable maxValues={30} w={330} {...COMPACT} />
              <MultiSelect label={t("panel.metrics")} data={[...catalogue.values()].map((m) => ({ value: m.kind, label: t(`metrics.${m.kind}`, words(m.kind)) }))} value={metrics} onChange={(next) => put({ m: next.join(",") })} searchable maxValues={20} w={330} {...COMPACT} />
            </Group>
            <Group gap="xl" align="center">
              <SegmentedControl
                size="xs"
                aria-label={t("influence.reading")}
                value={kind}
                onChange={(next) => put({ kind: next })}
                data={[
                  { value: "elasticity", label: t("influence.elasticity") },
                  { value: "coefficient", label: t("influence.coefficient") },
                ]}
              />
              <div style={{ width: 260 }}>
                <Text fz="xs" id="change">
                  {t("influence.change", { change: shownChange })}
                </Text>
                <Slider min={-50} max={50} step={1} value={shownChange} onChange={setShownChange} onChangeEnd={(next) => put({ change: String(next === 0 ? 1 : next) })} thumbLabel={t("influence.change", { change: shownChange })} label={(v) => `${v} %`} disabled={kind === "elasticity"} />
              </div>
            </Group>
            <Text fz="sm" c="dimmed">
              {t(kind === "elasticity" ? "influence.elasticityDoc" : "influence.coefficientDoc", { change })}
            </Text>
          </>
        )}
        {study.data && (
          <Group align="flex-start" gap="lg" wrap="wrap">
            <Table.ScrollContainer minWidth={420} style={{ flex: "20 1 480px" }}>
              <Table withTableBorder withColumnBorders horizontalSpacing={8} data-testid="influence" aria-busy={study.isFetching}>
                <Table.Thead>
                  <Table.Tr>
                    <Table.Th>{t("influence.metric")}</Table.Th>
                    <Table.Th ta="right">{t("influence.base")}</Table.Th>
                    {parameters.map((name) => (
                      <Table.Th key={name} ta="right" data-chosen={name === column} className={classes.column}>
                        <UnstyledButton fz="sm" miw={24} mih={24} ta="center" onClick={() => put({ col: name === column ? "" : name })} aria-pressed={name === column} aria-label={t("influence.readColumn", { parameter: name })} title={t("influence.readColumn", { parameter: name })}>
                          ▾
                        </UnstyledButton>
                        <Text component={Link} to={panelOf(name)} fz="xs" fw={600} c="var(--mantine-color-anchor)" title={t("influence.toPanel")}>
                          {name.split(/(?<=[._])/).map((part) => (
                            <Fragment key={part}>
                              {part}
                              <wbr />
                            </Fragment>
                          ))}
                        </Text>
                      </Table.Th>
                    ))}
                  </Table.Tr>
                </Table.Thead>
                <Table.Tbody>
                  {metrics.map((metric) => {
                    const base = study.data.base[metric];
                    return (
                      <Table.Tr key={metric} data-chosen={column === null && metric === chosen} className={classes.row}>
                        <Table.Td>
                          <UnstyledButton fz="sm" onClick={() => put({ row: metric, col: "" })} aria-pressed={column === null && metric === chosen}>
                            {metricName(metric)}
                          </UnstyledButton>
                        </Table.Td>
                        <Table.Td ta="right" className={`numbers ${classes.whole}`} title={base?.advice ?? undefined}>
                          {base && <MetricValue kind={metric} metric={base} />}
                        </Table.Td>
                        {parameters.map((name) => {
                          const v = value(metric, name);
                          const size = v === null ? 0 : sizeOf(v, largest);
                          const strongest = study.data.strongest.by_metric[metric] === name;
                          const most = study.data.strongest.by_parameter[name] === metric;
                          return (
                            <Table.Td key={name} ta="right" className={`numbers ${classes.cell}`} data-sign={(v ?? 0) < 0 ? "minus" : "plus"} style={{ "--size": `${Math.round(100 * size)}%` } as React.CSSProperties} fw={strongest ? 700 : 400}>
                              {v === null ? "–" : formatNumber(v, 3)}
                              {strongest && <span title={t("influence.strongest")}> ★</span>}
                              {most && <span title={t("influence.mostMoved")}> ☆</span>}
                            </Table.Td>
                          );
                        })}
                      </Table.Tr>
                    );
                  })}
                </Table.Tbody>
              </Table>
            </Table.ScrollContainer>
            <section className={classes.tornado} aria-label={heading} data-testid="tornado">
              <Title order={2} mb="xs">
                {heading}
              </Title>
              <div className={classes.lines}>
              {bars.map((bar) => (
                <div key={bar.name} className={classes.line}>
                  {column === null ? (
                    <Text component={Link} to={panelOf(bar.name)} fz="xs" c="var(--mantine-color-anchor)" ta="right" className={classes.named}>
                      {bar.name}
                    </Text>
                  ) : (
                    <UnstyledButton fz="xs" ta="right" onClick={() => put({ row: bar.name, col: "" })}>
                      {metricName(bar.name)}
                    </UnstyledButton>
                  )}
                  <div className={classes.track}>
                    <div className={classes.bar} data-sign={bar.value < 0 ? "minus" : "plus"} style={{ width: `${(50 * Math.abs(bar.value)) / widest}%` }} />
                  </div>
                  <Text fz="xs" className="numbers">
                    {formatNumber(bar.value, 3)}
                  </Text>
                </div>
              ))}
              </div>
            </section>
          </Group>
        )}
        {opened && parameters.length === 0 && <Alert variant="outline">{t("influence.none")}</Alert>}
      </Stack>
    </div>
  );
}
