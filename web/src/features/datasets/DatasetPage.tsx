import { Anchor, Button, Group, MultiSelect, NativeSelect, Stack, Text, Title, useComputedColorScheme } from "@mantine/core";
import { keepPreviousData, useMutation, useQueries, useQuery } from "@tanstack/react-query";
import { useMemo } from "react";
import { useTranslation } from "react-i18next";
import { Link, useParams } from "react-router";
import { api, atOnce, must } from "@/shared/api/client";
import { datasetQuery } from "@/shared/api/datasets";
import { isProblem, Problem } from "@/shared/api/problem";
import type { components } from "@/shared/api/schema";
import { CommentsButton } from "@/shared/comments/CommentsButton";
import { ruleAndValue } from "@/shared/forms/faults";
import { Pairs } from "@/shared/plots/Pairs";
import { stroke } from "@/shared/plots/palette";
import { Plot } from "@/shared/plots/Plot";
import type { Curve, PlotSpec } from "@/shared/plots/types";
import { PlainEntry } from "@/shared/ui/PlainEntry";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { StatusBadge } from "@/shared/ui/StatusBadge";
import { Functions } from "./Functions";
import { drawnOf, stretchOf, usualSegment } from "./recording";
import { manifestOf } from "./upload";
import { formatNumber, prettyUnit, words } from "@/shared/units/format";
import { useQueryText } from "@/shared/ui/useQueryText";

const POINTS = 1600;
/** Pixels of a plot with its head and its legend: kept free until its samples come, so that nothing below it jumps. */
const ROOM = 260;

/** A recording: every channel over the same stretch of time, thinned by the service to lowest and highest values, and a spectrum. */
export function DatasetPage() {
  const { t } = useTranslation();
  const { id = "" } = useParams();
  const [query, setQuery] = useQueryText();
  const dataset = useQuery(datasetQuery(id));
  const ready = dataset.data?.status === "ready";
  const names = (dataset.data?.channels ?? []).map((channel) => String(channel.name));
  const end = dataset.data?.duration ?? 0;
  const [from, to] = stretchOf(query, end);
  const drawn = drawnOf(query, names);
  const put = (change: (next: URLSearchParams) => void) =>
    setQuery((next) => {
      change(next);
      return next;
    });
  const look = (a: number, b: number) =>
    put((next) => {
      next.set("from", String(Number(Math.max(0, a).toPrecision(8))));
      next.set("to", String(Number(Math.min(end, b).toPrecision(8))));
    });
  const choose = (key: string, value: string) => put((next) => (value ? next.set(key, value) : next.delete(key)));
  const draw = (chosen: string[]) =>
    put((next) => {
      next.delete("show");
      for (const name of chosen) next.append("show", name);
    });
  /** Why an end of the stretch cannot be where it was entered. */
  const outside = (value: number, least: number, most: number) => {
    return value < least || value > most || (least > 0 ? value === least : value === most) ? t("datasets.between", { least: formatNumber(least), most: formatNumber(most), value: formatNumber(value) }) : undefined;
  };
  const channels = useQueries({
    queries: drawn.map((name) => ({
      queryKey: ["channel", id, name, from, to],
      enabled: ready && to > from,
      placeholderData: keepPreviousData,
      queryFn: () => must(api.GET("/v1/datasets/{identifier}/channels/{name}", { params: { path: { identifier: id, name }, query: { start: from, end: to, points: POINTS } } })),
    })),
  });
  const chosen = query.get("channel") ?? names[0] ?? "";
  const quantity = query.get("quantity") === "density" ? "density" : "amplitude";
  const window = query.get("window") ?? "hann";
  const wanted = Number(query.get("segment")) || undefined;
  const usual = usualSegment(from, to, dataset.data?.sample_rate, dataset.data?.processing?.experiments);
  const segment = wanted ?? usual;
  const asked = { dataset: id, channel: chosen, part: [from, to], quantity, window, ...(segment ? { segment } : {}) };
  const spectrum = useQuery({
    queryKey: ["spectrum", asked],
    enabled: ready && chosen !== "" && to > from,
    retry: false,
    placeholderData: keepPreviousData,
    queryFn: () => analysed(asked),
  });
  if (dataset.isError) return <ProblemAlert error={dataset.error} m="md" onRetry={() => void dataset.refetch()} />;
  if (!dataset.data) return null;
  const third = (to - from) / 3;
  return (
    <div className="page">
      <PageHead title={dataset.data.name} doc={ready && names.length > 0 ? t(dataset.data.uneven ? "datasets.aboutUneven" : "datasets.about", { count: dataset.data.sample_count ?? 0, rate: formatNumber(dataset.data.sample_rate ?? 0), duration: formatNumber(end) }) : undefined}>
        <StatusBadge status={dataset.data.status} />
        <CommentsButton key={id} about={id} />
        {ready && names.length > 0 && (
          <Button component={Link} to={`/datasets/${id}/process`} variant="default">
            {t("process.open")}
          </Button>
        )}
        {ready && names.length > 1 && (
          <Button component={Link} to={`/datasets/${id}/frf`} variant="default">
            {t("spectra.frf")}
          </Button>
        )}
        {ready && names.length > 0 && (
          <Button component={Link} to={`/identify?dataset=${id}`} variant="default">
            {t("matching.identify")}
          </Button>
        )}
        {ready && names.length > 0 && (
          <Button component={Link} to={`/validate?dataset=${id}`} variant="default">
            {t("matching.validate")}
          </Button>
        )}
        <Button component={Link} to={`/lineage/${id}`} variant="default">
          {t("lineage.open")}
        </Button>
        <Button component={Link} to="/datasets" variant="default">
          {t("datasets.back")}
        </Button>
      </PageHead>
      <Stack gap="md">
        {dataset.data.error && <ProblemAlert error={new Problem({ title: "", status: 0, detail: "", ...(dataset.data.error as object) })} />}
        <ProblemAlert error={channels.find((c) => c.error)?.error} />
        {dataset.data.status === "open" && (
          <Text fz="sm">
            {manifestOf(id) ? (
              <Text component={Link} to={`/datasets/${id}/import`} inherit c="var(--mantine-color-anchor)">
                {t("importing.describe")}
              </Text>
            ) : (
              t("datasets.open")
            )}
          </Text>
        )}
        {dataset.data.groups.length > 1 && (
          <Group gap="xs" component="nav" aria-label={t("datasets.groupsOf")}>
            <Text fz="sm">{t("datasets.groupsOf")}</Text>
            {dataset.data.groups.map((group) =>
              group.dataset_id === id ? (
                <Text key={group.dataset_id} fz="sm" fw={700} aria-current="page">
                  {group.name}
                </Text>
              ) : (
                <Anchor key={group.dataset_id} component={Link} to={`/datasets/${group.dataset_id}`} fz="sm">
                  {group.name}
                </Anchor>
              ),
            )}
          </Group>
        )}
        {ready && dataset.data.functions.length > 0 && <Functions id={id} functions={dataset.data.functions} />}
        {ready && names.length > 0 && (
          <>
            <Group align="flex-end" gap="xs">
              <PlainEntry label={t("datasets.from")} unit="s" value={from} refuse={(value) => outside(value, 0, to)} onCommit={(value) => value !== undefined && look(value, to)} w={120} />
              <PlainEntry label={t("datasets.to")} unit="s" value={to} refuse={(value) => outside(value, from, end)} onCommit={(value) => value !== undefined && look(from, value)} w={120} />
              <Button variant="default" onClick={() => look(from + third, to - third)}>
                {t("datasets.zoomIn")}
              </Button>
              <Button variant="default" onClick={() => look(from - 3 * third, to + 3 * third)}>
                {t("datasets.zoomOut")}
              </Button>
              <Button variant="default" onClick={() => look(from - third, to - third)} disabled={from <= 0} aria-label={t("datasets.earlier")}>
                ←
              </Button>
              <Button variant="default" onClick={() => look(from + third, to + third)} disabled={to >= end} aria-label={t("datasets.later")}>
                →
              </Button>
              <Button variant="default" onClick={() => put((next) => ["from", "to"].forEach((key) => next.delete(key)))}>
                {t("datasets.whole")}
              </Button>
            </Group>
            {names.length > 1 && <MultiSelect label={t("datasets.drawn")} data={names} value={drawn} onChange={draw} searchable maw={620} />}
            <Pairs aria-busy={channels.some(({ isPlaceholderData }) => isPlaceholderData)}>
              {drawn.map((name, i) => {
                const data = channels[i]?.data;
                return (
                  <div key={name} style={{ minHeight: ROOM }}>
                    {data && <Channel name={name} data={data} index={names.indexOf(name)} onZoom={look} />}
                  </div>
                );
              })}
            </Pairs>
            <section aria-busy={spectrum.isPlaceholderData}>
              <Group align="flex-end" mb="xs">
                <Title order={2}>{t("datasets.spectrum")}</Title>
                <NativeSelect size="xs" label={t("datasets.channel")} data={names} value={chosen} onChange={(event) => choose("channel", event.currentTarget.value)} />
                <NativeSelect size="xs" label={t("spectra.quantity")} data={["amplitude", "density"].map((value) => ({ value, label: t(`spectra.quantities.${value}`) }))} value={quantity} onChange={(event) => choose("quantity", event.currentTarget.value)} />
                <NativeSelect size="xs" label={t("spectra.window")} data={["hann", "flat_top", "none"].map((value) => ({ value, label: t(`spectra.windows.${value}`) }))} value={window} onChange={(event) => choose("window", event.currentTarget.value)} />
                <PlainEntry label={t("spectra.segment")} unit="s" value={wanted} optional placeholder={usual ? formatNumber(usual) : t("datasets.whole")} refuse={(value) => (value > 0 ? undefined : ruleAndValue(t, "forms.positive", value))} error={isProblem(spectrum.error) ? spectrum.error.at("/segment") : undefined} onCommit={(value) => choose("segment", value === undefined ? "" : String(value))} w={150} />
                {spectrum.data && <Keep key={JSON.stringify(asked)} asked={asked} />}
              </Group>
              <ProblemAlert error={spectrum.error} shown={["/segment"]} />
              {spectrum.data && <Spectrum name={chosen} reply={spectrum.data} />}
            </section>
          </>
        )}
      </Stack>
    </div>
  );
}

/** The spectrum of a recording as the service computes it, and keeps it where that is asked for. */
const analysed = (asked: object) => atOnce(api.POST("/v1/spectra", { body: asked as components["schemas"]["SpectrumRequest"] }));

/** Keeps what is shown, and then leads there. */
function Keep({ asked }: { asked: object }) {
  const { t } = useTranslation();
  const keep = useMutation({ mutationFn: () => analysed({ ...asked, keep: true }) });
  return (
    <>
      {keep.data?.id ? (
        <Button variant="default" component={Link} to={`/results/${keep.data.id}`}>
          {t("results.open")}
        </Button>
      ) : (
        <Button variant="default" onClick={() => keep.mutate()} loading={keep.isPending}>
          {t("results.keep")}
        </Button>
      )}
      <ProblemAlert error={keep.error} />
    </>
  );
}

const plain = (values: (number | null)[] | null | undefined): Float64Array => Float64Array.from(values ?? [], (value) => value ?? NaN);

function Channel({ name, data, index, onZoom }: { name: string; data: components["schemas"]["ChannelReply"]; index: number; onZoom(from: number, to: number): void }) {
  const { t } = useTranslation();
  const dark = useComputedColorScheme("light") === "dark";
  const thinned = data.min != null && data.max != null;
  const spec = useMemo<PlotSpec>(() => {
    const { color } = stroke(index, dark);
    const series = thinned ? [{ label: t("datasets.lowest"), color, dash: [] }, { label: t("datasets.highest"), color, dash: [5, 2] }] : [{ label: name, color, dash: [] }];
    return { title: words(name), x: { label: t("panel.time"), unit: "s" }, y: { label: words(name), unit: prettyUnit(data.unit) }, series, dark };
  }, [name, data.unit, thinned, index, dark, t]);
  const curves = useMemo<Curve[]>(() => {
    const x = plain(data.time);
    return thinned ? [{ x, y: plain(data.min) }, { x, y: plain(data.max) }] : [{ x, y: plain(data.values) }];
  }, [data, thinned]);
  return <Plot spec={spec} curves={curves} height={200} summary={t("datasets.summary", { name, unit: data.unit })} onZoom={onZoom} />;
}

export function Spectrum({ name, reply }: { name: string; reply: components["schemas"]["SpectrumReply"] }) {
  const { t } = useTranslation();
  const dark = useComputedColorScheme("light") === "dark";
  const spec = useMemo<PlotSpec>(() => ({ title: t("datasets.spectrumOf", { name }), x: { label: "ω", unit: "rad/s", log: true }, y: { label: t(reply.quantity === "density" ? "spectra.density" : "datasets.amplitude"), unit: prettyUnit(reply.unit) }, series: [{ label: words(name), ...stroke(0, dark), width: 1.2 }], dark }), [name, reply.unit, reply.quantity, dark, t]);
  const curves = useMemo<Curve[]>(() => {
    const variant = reply.variants[0];
    const x = plain(variant?.frequency);
    const y = plain(variant?.value);
    // A logarithmic axis has no place for 0 rad/s.
    const first = x.findIndex((w) => w > 0);
    return [{ x: x.subarray(Math.max(first, 0)), y: y.subarray(Math.max(first, 0)) }];
  }, [reply]);
  return <Plot spec={spec} curves={curves} height={220} summary={t("datasets.spectrumOf", { name })} />;
}
