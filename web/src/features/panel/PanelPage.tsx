import { Alert, Badge, Button, Group, Stack, Text } from "@mantine/core";
import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useCallback, useEffect, useMemo, useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import { useParams } from "react-router";
import { saveSystem, systemQuery } from "@/shared/api/systems";
import type { Frame } from "@/shared/live/protocol";
import { Busy } from "@/shared/ui/Busy";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { withUnit, words } from "@/shared/units/format";
import { CompareBar } from "./CompareBar";
import { gainsOf } from "@/shared/systems/controllers";
import { loopsOf } from "@/shared/systems/loops";
import { MetricStrip } from "./MetricStrip";
import classes from "./PanelPage.module.css";
import { ResponsePlots, type PlotsHandle } from "@/shared/responses/ResponsePlots";
import { PanelSetup } from "./PanelSetup";
import { ParamSlider } from "./ParamSlider";
import { GoalBar } from "./GoalBar";
import type { PanelGoal } from "@/shared/responses/goals";
import { MeasuredSetup } from "@/shared/responses/MeasuredSetup";
import { PLANES } from "@/shared/responses/pull";
import { firstPlots, mainOutput, usualMetrics } from "@/shared/responses/view";
import { travelOf, type Scale } from "./scale";
import { useLocus } from "./useLocus";
import { usePull } from "./usePull";
import { SnapshotTray } from "./SnapshotTray";
import { withValues } from "@/shared/systems/apply";
import { searchAt, type ProblemForm } from "@/shared/systems/search";
import { keepLast, lastOf, type Last } from "@/shared/systems/last";
import { firstSliders } from "@/shared/systems/movable";
import { useQueryText } from "@/shared/ui/useQueryText";
import { pathsOf, readState, variantsOf, writeState, type PanelState } from "./state";
import { useLive } from "@/shared/responses/useLive";

/** The ends of the frequencies above 0, rad/s. */
function rangeOf(frequency: Float32Array): [number, number] | null {
  const low = frequency.find((one) => one > 0);
  const high = frequency[frequency.length - 1]!;
  return low !== undefined && high > low ? [low, high] : null;
}

const NONE: Record<string, number | null> = {};

/** Sliders on the left, every characteristic answer on the right, at once. */
export function PanelPage() {
  const { t } = useTranslation();
  const { id = "" } = useParams();
  const system = useQuery(systemQuery(id)).data!;
  const queries = useQueryClient();
  const [query, setQuery] = useQueryText();
  const state = useMemo(() => readState(query), [query]);
  const change = useCallback((part: Partial<PanelState>) => setQuery((before) => writeState({ ...readState(before), ...part }, before)), [setQuery]);
  const loops = useMemo(() => loopsOf(system.document), [system.document]);

  const plots = useRef<PlotsHandle>(null);
  const moving = useRef<Record<string, number>>(state.values);
  const gesture = useRef(false);
  const pending = useRef<Frame | null>(null);
  const onFrame = useCallback((frame: Frame) => {
    // One picture for each frame of the screen: of several that came, the newest.
    if (pending.current === null) {
      requestAnimationFrame(() => {
        const newest = pending.current;
        pending.current = null;
        if (newest) plots.current?.draw(newest);
        setVerdict(newest?.variants[0]?.verdict ?? "ok");
        if (newest && newest.frequency.length > 1) setRange((before) => before ?? rangeOf(newest.frequency));
      });
    }
    pending.current = frame;
  }, []);
  const [verdict, setVerdict] = useState("ok");
  /** Of the frequencies that are drawn; of each system and loop the first ones. */
  const [range, setRange] = useState<[number, number] | null>(null);

  // The vectors' parameters belong to what is opened, so a new slider opens anew; that costs milliseconds.
  const [known, setKnown] = useState<Awaited<ReturnType<typeof useLive>>["opened"]>(null);
  const parameters = useMemo(() => new Map((known?.parameters ?? []).map((p) => [p.path, p])), [known]);
  const paths = pathsOf(state, parameters);
  const output = known ? mainOutput(state, known) : state.output;
  const input = state.input ?? known?.inputs[0];
  const frequency = state.loop ? { open_at: state.loop } : input && output ? { from: input, to: state.path?.[1] ?? output } : undefined;
  const live = useLive(
    {
      system: id,
      parameters: paths,
      ...(state.input || state.amplitude !== 1 ? (input ? { input: { port: input, signal: { kind: "step", amplitude: state.amplitude } } } : {}) : {}),
      // What the service takes by itself is not asked for: once it is known, the panel would be opened anew.
      ...(state.output !== null && state.output === output ? { output } : {}),
      ...(frequency ? { frequency } : {}),
      metrics: [...new Set([...(state.metrics ?? usualMetrics(loops)), ...state.goals.map((goal) => goal.metric)])],
      ...(state.measured.length > 0 ? { measured: state.measured } : {}),
      duration: state.duration ?? "auto",
    },
    onFrame,
    // A new revision is another system: it is opened anew.
    system.revision,
  );
  useEffect(() => {
    if (live.opened) setKnown(live.opened);
  }, [live.opened]);

  // A system opens as it was left in this browser; a panel that nobody has arranged, with the author's parameters and the first loop.
  useEffect(() => {
    const last = query.size === 0 ? lastOf(id) : null;
    if (last) return setQuery(() => new URLSearchParams(last.query));
    if (!known || query.has("s")) return;
    change({ sliders: firstSliders(known.parameters), ...(state.loop || state.path || loops.length === 0 ? {} : { loop: loops[0]! }) });
  }, [id, known, query, setQuery, change, loops, state.loop, state.path]);

  const show = useCallback((path: string, value: number) => `${path} = ${withUnit(value, parameters.get(path)?.unit ?? "")}`, [parameters]);
  const names = { current: t("panel.current"), reference: t("panel.reference") };
  const { variants } = variantsOf(state, parameters, state.values, names, show);

  const send = (values: Record<string, number>) => {
    const made = variantsOf(state, parameters, values, names, show);
    if (made.variants[0]!.vector.length > 0 || made.paths.length === 0) live.set(made.variants.map((v) => v.vector), 1 + made.variants.filter((v) => v.kind === "reference" || v.kind === "snapshot").length);
  };
  const latest = useRef(send);
  latest.current = send;
  useEffect(() => {
    // With parameters that are known only now the panel is opened anew: nothing is computed before.
    if (!live.opened || live.opened !== known) return;
    // The address is drawn a moment after it changed: what is under a hand by then goes before it.
    if (!gesture.current) moving.current = state.values;
    latest.current(moving.current);
  }, [live.opened, known, state]);
  useEffect(() => setRange(null), [live.opened]);
  useEffect(() => plots.current?.forget(), [state.input, state.amplitude, state.loop, state.path?.join(), state.duration, system.revision]);

  const onMove = useCallback((path: string, value: number) => {
    if (!gesture.current) {
      gesture.current = true;
      plots.current?.leaveGhost();
    }
    moving.current = { ...moving.current, [path]: value };
    latest.current(moving.current);
  }, []);
  const onCommit = useCallback(
    (path: string, value: number) => {
      if (!gesture.current) return;
      gesture.current = false;
      setQuery((before) => {
        const held = readState(before);
        return writeState({ ...held, values: { ...held.values, [path]: value } }, before);
      });
    },
    [setQuery],
  );
  const onRemove = useCallback((path: string) => change({ sliders: state.sliders.filter((p) => p !== path) }), [change, state.sliders]);

  const chosen = useMemo(() => state.plots ?? firstPlots(known?.curves ?? [], output ?? "", state.loop !== null), [state.plots, known, output, state.loop]);
  const locusOf = known && !known.nonlinear && state.locus ? parameters.get(state.locus) : undefined;
  const found = useLocus({ system: id, revision: system.revision, parameter: locusOf?.bound ? undefined : locusOf, scale: state.scales[state.locus ?? ""], values: state.values, from: input, to: output ?? undefined });
  /** What is taken hold of, for a parameter that follows it. */
  const followed = useCallback((path: string, label: "panel.locusOf" | "panel.pullOf") => ({ label: t(label, { path }), value: () => moving.current[path] ?? parameters.get(path)?.value ?? NaN, text: (value: number) => show(path, value) }), [parameters, show, t]);
  const follow = useCallback(
    (path: string, value: number, done: boolean) => {
      const rounded = Number(value.toPrecision(4));
      onMove(path, rounded);
      if (done) onCommit(path, rounded);
    },
    [onMove, onCommit],
  );
  const locus = useMemo(() => found.locus && { locus: found.locus, ...followed(found.locus.path, "panel.locusOf") }, [found.locus, followed]);
  const onLocus = useCallback((value: number, done: boolean) => found.locus && follow(found.locus.path, value, done), [found.locus, follow]);
  const chooseLocus = useCallback(
    (path: string) => change(state.locus === path ? { locus: null } : { locus: path, ...(state.plots && !state.plots.includes("poles") ? { plots: [...state.plots, "poles"] } : {}) }),
    [change, state.locus, state.plots],
  );

  // Pulled curves move what was chosen for it; where nobody has chosen, the first gain of the controller that has a slider.
  const pulls = state.pull ?? (state.loop ? gainsOf(system.document, known?.parameters ?? []).find((path) => state.sliders.includes(path)) : undefined);
  const pulled = pulls ? parameters.get(pulls) : undefined;
  const overFrequency = chosen.some((kind) => PLANES.includes(kind));
  const { family, error: unpulled } = usePull({ system: id, revision: system.revision, parameter: pulled?.bound || !overFrequency ? undefined : pulled, scale: state.scales[pulls ?? ""], values: state.values, shown: frequency as never, range });
  const pull = useMemo(() => family && { family, ...followed(family.path, "panel.pullOf") }, [family, followed]);
  const onPull = useCallback((value: number, done: boolean) => family && follow(family.path, value, done), [family, follow]);
  const choosePull = useCallback((path: string) => change({ pull: path }), [change]);

  const onKnob = useCallback((path: string, knob: boolean) => change({ knobs: knob ? [...state.knobs, path] : state.knobs.filter((p) => p !== path) }), [change, state.knobs]);
  const onScale = useCallback((path: string, scale: Scale) => change({ scales: { ...state.scales, [path]: scale } }), [change, state.scales]);
  // While the edge of a zone is dragged its goal moves here; the address hears of it when it is let go.
  const [dragged, setDragged] = useState<PanelGoal | null>(null);
  const goals = useMemo(() => state.goals.map((goal) => (dragged?.metric === goal.metric ? dragged : goal)), [state.goals, dragged]);
  const onGoal = useCallback(
    (metric: string, value: number, done: boolean) => {
      const rounded = Number(value.toPrecision(3));
      const moved = state.goals.map((goal) => (goal.metric === metric ? { ...goal, value: rounded } : goal));
      setDragged(done ? null : (moved.find((goal) => goal.metric === metric) ?? null));
      if (done) change({ goals: moved });
    },
    [change, state.goals],
  );

  const save = useMutation({
    mutationFn: (values: Record<string, number>) => saveSystem(id, withValues(system.document, Object.fromEntries(Object.entries(values).map(([path, value]) => [path, { value, unit: parameters.get(path)?.unit ?? "" }]))), system.etag),
    onSuccess: async (_, saved) => {
      // What was moved while it was being saved is not saved yet.
      setQuery((before) => {
        const held = readState(before);
        return writeState({ ...held, values: Object.fromEntries(Object.entries(held.values).filter(([path, value]) => value !== saved[path])) }, before);
      });
      await queries.invalidateQueries({ queryKey: ["system", id] });
    },
  });

  const first = live.measured.get(0);
  const second = state.reference ? live.measured.get(1) : undefined;
  const metric = state.metric ?? Object.keys(first?.elasticities ?? {})[0] ?? "overshoot";
  const elasticities = first?.elasticities[metric] ?? NONE;
  const influences = useMemo(() => {
    const largest = Math.max(0, ...Object.values(elasticities).map((e) => Math.abs(e ?? 0)));
    return new Map(Object.entries(elasticities).flatMap(([path, e]) => (e != null && largest > 0 ? [[path, { part: e / largest, value: e }]] : [])));
  }, [elasticities]);
  const moved = Object.keys(state.values).length > 0;
  // Only what they are called: values that change must not make new plots.
  const labels = JSON.stringify(variants.map(({ label, kind }) => ({ label, kind })));
  const shown = useMemo(() => JSON.parse(labels) as { label: string; kind: (typeof variants)[number]["kind"] }[], [labels]);
  const searched: ProblemForm = {
    input: input ?? "",
    amplitude: state.amplitude,
    loop: state.loop ?? loops[0] ?? "",
    variables: state.sliders.flatMap((parameter) => {
      const known = parameters.get(parameter);
      if (!known || known.bound) return [];
      const { low, high } = travelOf(known);
      return [{ parameter, lower: Number(low.toPrecision(4)), upper: Number(high.toPrecision(4)) }];
    }),
    goals: goals.map(({ metric: name, bound, value }) => ({ metric: name, output: output ?? "", sense: "", [bound]: value })),
    scenarios: "",
    method: "auto",
    options: {},
  };
  const kept = JSON.stringify({ query: query.toString(), search: { input: searched.input, amplitude: searched.amplitude, loop: searched.loop, goals: searched.goals, output: output ?? "", values: state.values } } satisfies Last);
  useEffect(() => {
    if (known && query.has("s")) keepLast(id, JSON.parse(kept) as Last);
  }, [id, known, query, kept]);

  return (
    <div className={classes.page}>
      <aside className={classes.side} aria-label={t("panel.sliders")} data-tour-of="panel">
        <Group justify="space-between" wrap="nowrap">
          <Text fw={600} fz="sm" component="h2">
            {t("panel.parameters")}
          </Text>
          <Button variant="subtle" size="compact-xs" disabled={!moved} onClick={() => change({ values: {} })}>
            {t("panel.resetAll")}
          </Button>
        </Group>
        <Text fz="xs" c="dimmed">
          {t("panel.influenceOf", { metric: t(`metrics.${metric}`, words(metric)) })}
        </Text>
        {state.sliders.map((path) => {
          const parameter = parameters.get(path);
          if (!parameter || parameter.bound) return null;
          return (
            <ParamSlider
              key={path}
              parameter={parameter}
              value={state.values[path] ?? parameter.value}
              influence={influences.get(path) ?? null}
              metric={t(`metrics.${metric}`, words(metric))}
              knob={state.knobs.includes(path)}
              scale={state.scales[path]}
              onKnob={onKnob}
              locus={state.locus === path}
              onLocus={known?.nonlinear ? undefined : chooseLocus}
              pull={pulls === path}
              onPull={choosePull}
              onScale={onScale}
              onMove={onMove}
              onCommit={onCommit}
              onRemove={onRemove}
            />
          );
        })}
        <Button mt="sm" fullWidth variant="light" disabled={!moved} loading={save.isPending} onClick={() => save.mutate(state.values)}>
          {t("panel.save")}
        </Button>
        <ProblemAlert error={save.error} />
        <Text fz="xs" c="dimmed" mt="xs">
          {t("panel.keys")}
        </Text>
      </aside>
      <Stack gap="xs" className={classes.main}>
        {known && <PanelSetup state={state} opened={known} loops={loops} plots={chosen} onChange={change} />}
        {known && (
          <Group gap="xs">
            <CompareBar state={state} parameters={parameters} onChange={change} onPin={() => change({ reference: { ...state.values } })} />
            <SnapshotTray snapshots={state.snapshots} parameters={parameters} values={state.values} metrics={known.metrics} measured={variants.map((variant, i) => ({ label: variant.label, metrics: live.measured.get(i)?.metrics }))} onChange={(snapshots) => change({ snapshots })} onApply={(values) => change({ values })} />
            <MeasuredSetup measured={state.measured} opened={known} output={output ?? ""} onChange={(measured) => change({ measured })} />
            <GoalBar goals={goals} current={first?.metrics ?? {}} metrics={live.opened?.metrics ?? known.metrics} search={searchAt(id, searched)} onChange={(next) => change({ goals: next })} />
          </Group>
        )}
        <Group gap="sm" align="center">
          {known && <MetricStrip names={live.opened?.metrics ?? known.metrics} current={first?.metrics ?? {}} reference={second?.metrics ?? null} stale={live.stale} selected={metric} goals={goals} onSelect={(chosen) => change({ metric: chosen })} />}
          {verdict !== "ok" && (
            <Badge color="red" variant="filled" tt="none" size="lg" role="status">
              {t(`verdicts.${verdict}`, verdict)}
            </Badge>
          )}
        </Group>
        {live.state === "lost" && (
          <Alert color="orange" variant="outline" role="status">
            {t("panel.lost")}
          </Alert>
        )}
        <ProblemAlert error={live.problem ?? found.error ?? unpulled} />
        {!known && !live.problem && live.state !== "lost" && <Busy>{t("panel.opening")}</Busy>}
        {known && <ResponsePlots ref={plots} opened={known} plots={chosen} variants={shown} goals={goals} output={output ?? ""} loop={state.loop !== null} locus={locus} onLocus={onLocus} pull={pull} onPull={onPull} onGoal={onGoal} />}
      </Stack>
    </div>
  );
}
