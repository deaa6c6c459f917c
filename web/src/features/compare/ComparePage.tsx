import { Alert, Button, Group, Stack, Title } from "@mantine/core";
import { useQueries, useQuery, useQueryClient } from "@tanstack/react-query";
import { useCallback, useEffect, useMemo, useRef } from "react";
import { useTranslation } from "react-i18next";
import { metricsQuery } from "@/shared/api/catalogue";
import { MeasuredSetup, MOST_MEASURED } from "@/shared/responses/MeasuredSetup";
import { ResponsePlots, type PlotsHandle } from "@/shared/responses/ResponsePlots";
import { firstPlots, mainOutput, readView, usualMetrics, VIEW_KEYS, writeView, type View } from "@/shared/responses/view";
import { PlotChoice, ViewSetup } from "@/shared/responses/ViewSetup";
import { designText, MOST_DESIGNS, readDesigns, type DesignRef } from "@/shared/systems/compared";
import { openedOnce } from "@/shared/systems/described";
import { Busy } from "@/shared/ui/Busy";
import { Empty } from "@/shared/ui/Empty";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { useQueryText } from "@/shared/ui/useQueryText";
import { words } from "@/shared/units/format";
import { AddDesign } from "./AddDesign";
import { CompareTable, type Head } from "./CompareTable";
import { common, designQuery, labelsOf, type Design } from "./designs";
import { frameOf, openedOf, rowsOf } from "./overlaid";
import { recordedQuery } from "./recorded";
import { axesOf, drawnQuery, measuredQuery, SAMPLES, type Question } from "./study";

const NO_GOALS: never[] = [];
const ignore = () => undefined;

/** Designs side by side: metrics and parameters that differ in one table, their curves laid over each other. */
export function ComparePage() {
  const { t, i18n } = useTranslation();
  const client = useQueryClient();
  const [query, setQuery] = useQueryText();
  const refs = useMemo(() => readDesigns(query), [query]);
  const view = useMemo(() => readView(query), [query]);
  const change = useCallback((part: Partial<View>) => setQuery((before) => changed(before, part)), [setQuery]);
  const choose = (next: readonly DesignRef[]) =>
    setQuery((before) => {
      before.delete("d");
      for (const ref of next) before.append("d", designText(ref));
      return before;
    });
  const domains = useQuery(metricsQuery);
  const asked = useQueries({ queries: refs.map((ref) => designQuery(ref, client, t, i18n.language)) });
  const found = asked.flatMap(({ data }) => data ?? []);
  const drop = (id: string) => choose(refs.filter((ref) => designText(ref) !== id));
  /** A channel lies over the output of its name, else over the one whose metrics are shown. */
  const onRecording = (dataset: string, channel: string) => {
    const union = openedOf(found, [], 0);
    const output = union.curves.includes(channel) ? channel : mainOutput(view, union);
    change({ measured: [...view.measured, { output, dataset, channel, start: 0, relative: false }] });
  };
  const pending = asked.some(({ isPending }) => isPending) || domains.isPending;
  return (
    <div className="page">
      <PageHead title={t("compare.title")} doc={t("compare.doc")}>
        {refs.length > 0 && <AddDesign full={refs.length >= MOST_DESIGNS} onAdd={(ref) => choose([...refs, ref])} {...(found.length > 0 && view.measured.length < MOST_MEASURED ? { onRecording, outputs: openedOf(found, [], 0).curves } : {})} />}
      </PageHead>
      <Stack gap="md">
        <ProblemAlert error={domains.error} />
        {asked.map(({ error }, i) => error && <Refused key={designText(refs[i]!)} name={designText(refs[i]!)} error={error} onDrop={() => drop(designText(refs[i]!))} />)}
        {refs.length === 0 && (
          <Empty title={t("compare.none")} action={<AddDesign full={false} onAdd={(ref) => choose([ref])} />}>
            {t("compare.noneDoc")}
          </Empty>
        )}
        {refs.length > 0 && pending && <Busy>{t("panel.opening")}</Busy>}
        {!pending && domains.data && found.length > 0 && <Compared designs={found} view={view} domains={domains.data} onChange={change} onDrop={drop} />}
      </Stack>
    </div>
  );
}

function changed(before: URLSearchParams, part: Partial<View>): URLSearchParams {
  const view = { ...readView(before), ...part };
  for (const key of VIEW_KEYS) before.delete(key);
  writeView(view, before);
  return before;
}

function Refused({ name, error, onDrop }: { name: string; error: Error; onDrop(): void }) {
  const { t } = useTranslation();
  return (
    <Group gap="xs" align="flex-start">
      <ProblemAlert error={error} />
      <Button variant="default" onClick={onDrop}>
        {t("compare.drop", { name })}
      </Button>
    </Group>
  );
}

interface ComparedProps {
  designs: Design[];
  view: View;
  domains: Parameters<typeof measuredQuery>[2];
  onChange(part: Partial<View>): void;
  onDrop(id: string): void;
}

/** Everything that is asked of designs which are known, and what comes of it. */
function Compared({ designs, view, domains, onChange, onDrop }: ComparedProps) {
  const { t } = useTranslation();
  const inputs = common(designs.map((design) => design.inputs));
  const loops = common(designs.map((design) => design.loops));
  const union = openedOf(designs, [], 0);
  const output = mainOutput(view, union);
  const input = inputs.find((name) => name === view.input) ?? inputs[0];
  const loop = loops.find((name) => name === view.loop) ?? (view.path ? null : (loops[0] ?? null));
  const question: Question | null = input === undefined ? null : { input, output, loop, amplitude: view.amplitude, duration: view.duration, metrics: usualMetrics(loops) };
  const measured = useQueries({ queries: question ? designs.map((design) => measuredQuery(design, question, domains)) : [] });
  const waiting = measured.some(({ isPending }) => isPending);
  const known = measured.flatMap(({ data }) => data ?? []);
  const axes = waiting || known.length === 0 ? null : axesOf(known);
  const drawn = useQueries({ queries: question && axes ? designs.map((design) => drawnQuery(design, question, axes)) : [] });
  const overlays = useQuery({
    queryKey: ["compare", "recorded", designs[0]!.id, view.measured, axes?.end],
    enabled: axes !== null && view.measured.length > 0,
    staleTime: Infinity,
    retry: false,
    queryFn: () => openedOnce({ system: designs.find((design) => view.measured.every((one) => design.outputs.has(one.output)))?.document ?? designs[0]!.document, measured: view.measured, samples: SAMPLES, duration: axes!.end }),
  });
  const recorded = view.measured.length > 0 ? overlays.data?.measured : undefined;
  const ofRecordings = useQueries({ queries: axes ? view.measured.map((overlay) => recordedQuery(overlay, axes.end, usualMetrics([]))) : [] });
  const labels = labelsOf(designs);
  const columns = [...designs.map((_, i) => measured[i]?.data?.metrics), ...view.measured.map((_, i) => ofRecordings[i]?.data)];
  const rows = rowsOf(designs, columns, question?.metrics ?? []);
  const heads: Head[] = [
    ...designs.map(({ id, to }, i) => ({ id, label: labels[i]!, to, onDrop: () => onDrop(id) })),
    ...view.measured.map(({ dataset, channel }, i) => ({ id: `recording ${i}`, label: t("compare.recorded", { channel: words(channel) }), to: `/datasets/${dataset}`, doc: t("compare.recordedDoc"), onDrop: () => onChange({ measured: view.measured.filter((_, k) => k !== i) }) })),
  ];
  const state = { ...view, input: input ?? null, loop };
  const chosen = view.plots ?? firstPlots([...union.curves], output, loop !== null);
  const faults = designs.map((_, i) => measured[i]?.error ?? drawn[i]?.error ?? null);
  return (
    <>
      {input === undefined ? (
        <Alert color="orange" variant="outline" title={t("compare.noInput")}>
          {designs.map((design, i) => `${labels[i]}: ${design.inputs.join(", ") || "–"}`).join("; ")}
        </Alert>
      ) : (
        <Group gap="xs" align="flex-end">
          <ViewSetup view={state} opened={{ inputs, outputs: union.outputs }} loops={loops} onChange={onChange}>
            <PlotChoice curves={union.curves} plots={chosen} onChange={(plots) => onChange({ plots })} />
          </ViewSetup>
          <MeasuredSetup measured={view.measured} opened={union} output={output} onChange={(next) => onChange({ measured: next })} />
        </Group>
      )}
      {faults.map((error, i) => error && <Refused key={designs[i]!.id} name={labels[i]!} error={error} onDrop={() => onDrop(designs[i]!.id)} />)}
      <ProblemAlert error={overlays.error ?? ofRecordings.find(({ error }) => error)?.error} />
      <CompareTable heads={heads} rows={rows} pending={waiting || ofRecordings.some(({ isPending }) => isPending)} />
      {question && axes && <Overlaid designs={designs} labels={labelsOf(designs, true)} drawn={drawn.map(({ data }) => data)} axes={axes} recorded={recorded} plots={chosen} output={output} loop={loop !== null} />}
      {waiting && <Busy>{t("panel.measuring")}</Busy>}
    </>
  );
}

interface OverlaidProps {
  designs: Design[];
  labels: string[];
  drawn: (Parameters<typeof frameOf>[3][number] | undefined)[];
  axes: Parameters<typeof frameOf>[4];
  recorded: Parameters<typeof openedOf>[1] | undefined;
  plots: string[];
  output: string;
  loop: boolean;
}

/** The curves of all designs that have come, in one picture for each plot. */
function Overlaid({ designs, labels, drawn, axes, recorded, plots, output, loop }: OverlaidProps) {
  const { t } = useTranslation();
  const handle = useRef<PlotsHandle>(null);
  const names = JSON.stringify(labels);
  const opened = useMemo(() => openedOf(designs, recorded ?? [], axes.end), [designs.map(({ id }) => id).join(), recorded, axes.end]);
  const variants = useMemo(() => (JSON.parse(names) as string[]).map((label) => ({ label, kind: "compare" as const })), [names]);
  const kinds = useMemo(() => plots, [plots.join()]);
  const came = drawn.map((own) => (own ? own.verdict : "")).join();
  useEffect(() => {
    const none = { verdict: "ok", outputs: {}, re: [], im: [], poles: [] };
    handle.current?.draw(frameOf(1, opened, designs, drawn.map((own) => own ?? none), axes, SAMPLES));
  });
  return (
    <section aria-label={t("compare.curves")} data-drawn={came}>
      <Title order={2} mb="xs">
        {t("compare.curves")}
      </Title>
      <ResponsePlots ref={handle} opened={opened} plots={kinds} variants={variants} goals={NO_GOALS} output={output} loop={loop} onGoal={ignore} />
    </section>
  );
}

