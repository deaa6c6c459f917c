import { useComputedColorScheme } from "@mantine/core";
import { forwardRef, memo, useCallback, useEffect, useImperativeHandle, useMemo, useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import { bode, type Frame, type Opened } from "@/shared/live/protocol";
import { Plot, type PlotHandle } from "@/shared/plots/Plot";
import { stroke } from "@/shared/plots/palette";
import { NOTHING, type Band, type Curve, type Decor, type Mark, type PlotSpec, type Point, type Series, type Zone } from "@/shared/plots/types";
import { formatMetric, formatNumber, prettyUnit, withUnit, words } from "@/shared/units/format";
import { boundAt, factsOf, WANTED, zoneOf, type Facts, type PanelGoal } from "./goals";
import { curveOf, dampingGrid, dominant, nearest, poleAt, type Locus } from "./locus";
import { marginsOf, type Margins } from "./margins";
import { nicholsChart } from "./nichols";
import { gripAt, PLANES, pointAt, wayOf, type Family, type Plane } from "./pull";
import classes from "./ResponsePlots.module.css";
import { frequenciesOf, spectrumOf } from "./spectrum";


export interface PlotsHandle {
  draw(frame: Frame): void;
  /** Leaves the moving curves of now behind as a shadow. */
  leaveGhost(): void;
  forget(): void;
}

/** A parameter that follows what is taken hold of. */
interface Told {
  label: string;
  value(): number;
  text(value: number): string;
}

interface Props {
  opened: Opened;
  plots: string[];
  variants: { label: string; kind: "current" | "reference" | "snapshot" | "compare" }[];
  goals: PanelGoal[];
  /** The output whose goals are drawn. */
  output: string;
  /** A loop is opened: it has margins. */
  loop: boolean;
  /** A root locus among the poles, with the value at which its parameter is, and how it is called and told. */
  locus?: (Told & { locus: Locus }) | null;
  /** What the curves do over frequency when they are pulled. */
  pull?: (Told & { family: Family }) | null;
  /** A curve was pulled to where the parameter has another value; `done` when it was let go. */
  onPull?(value: number, done: boolean): void;
  /** The locus was taken to another value; `done` when it was let go. */
  onLocus?(value: number, done: boolean): void;
  /** Of each plot, px. */
  height?: number;
  onGoal(metric: string, value: number, done: boolean): void;
}

const GHOSTS = 2;
/** Of a pole plot with a root locus, which takes two rows, px. */
const TALL = 516;
/** The id of the grip on a root locus, among those of the goals' zones. */
const LOCUS = "root locus";
/** That of the grip on a curve over frequency, before its plane. */
const PULL = "pull:";
const EMPTY: Curve = { x: [], y: [] };
const MEASURED = { light: "#6f42c1", dark: "#c9a7ff" };

/** All plots of a front panel, drawn from frames as they come, without React. */
export const ResponsePlots = memo(
  forwardRef<PlotsHandle, Props>(function ResponsePlots({ opened, plots, variants, goals, output, loop, locus = null, onLocus, pull = null, onPull, height, onGoal }, ref) {
    const { t } = useTranslation();
    const dark = useComputedColorScheme("light") === "dark";
    const handles = useRef(new Map<string, PlotHandle>());
    const frame = useRef<Frame | null>(null);
    const facts = useRef<Facts | null>(null);
    const ghosts = useRef<Frame[]>([]);
    const [shadows, setShadows] = useState(0);
    const holder = useRef<HTMLDivElement>(null);
    const labels = variants.map((v) => `${v.kind}:${v.label}`).join("|");

    const series = useMemo<Series[]>(() => {
      const own = variants.map((variant, i): Series => ({ label: variant.label, ...stroke(i, dark), width: variant.kind === "current" ? 2.4 : 1.5 }));
      const grey = dark ? "#c4cad0" : "#5b6269";
      const shadows = Array.from({ length: GHOSTS }, (_, i): Series => ({ label: t("panel.ghost", { number: i + 1 }), color: grey, dash: i === 0 ? [1, 3] : [1, 6], faint: true }));
      return [...own, ...shadows];
      // The labels say all that matters of the variants.
    }, [labels, dark, t]);

    /** Recordings over each output, with what is drawn of them. */
    const recorded = useMemo(() => {
      const numbers = (values: (number | null)[]) => Float64Array.from(values, (value) => value ?? NaN);
      return (opened.measured ?? []).map((measured) => ({
        output: measured.output,
        values: numbers(measured.values),
        low: numbers(measured.low),
        high: numbers(measured.high),
        spectrum: spectrumOf(measured.values),
        series: { label: t("panel.measured", { channel: measured.channel, sigma: withUnit(measured.sigma, opened.outputs.find((o) => o.name === measured.output)?.unit ?? "", 2) }), color: dark ? MEASURED.dark : MEASURED.light, dash: [], width: 1.3 } as Series,
      }));
    }, [opened, dark, t]);

    const locusLabel = locus?.label;
    const specs = useMemo(() => {
      const units = new Map(opened.outputs.map((o) => [o.name, prettyUnit(o.unit)]));
      const frequency = { label: "ω", unit: "rad/s", log: true };
      const found = new Map<string, PlotSpec>();
      for (const kind of plots) {
        const [what, name = ""] = kind.split(":");
        const common = { series, dark };
        const withRecorded = [...series, ...recorded.filter((one) => one.output === name).map((one) => one.series)];
        if (what === "step" && units.has(name)) found.set(kind, { dark, series: withRecorded, title: words(name), x: { label: t("panel.time"), unit: "s" }, y: { label: words(name), unit: units.get(name)! } });
        else if (what === "spectrum" && units.has(name)) found.set(kind, { dark, series: withRecorded, title: t("panel.spectrumOf", { output: words(name) }), x: { label: "f", unit: "Hz", log: true }, y: { label: t("panel.amplitude"), unit: `dB(${units.get(name) || "1"})` }, span: 120 });
        else if (what === "bode") found.set(kind, { ...common, title: t("panel.magnitude"), x: frequency, y: { label: t("panel.magnitudeShort"), unit: "dB" }, clamp: [-80, 120], lines: [{ y: 0 }] });
        else if (what === "phase") found.set(kind, { ...common, title: t("panel.phase"), x: frequency, y: { label: t("panel.phaseShort"), unit: "°" }, clamp: [-720, 360], lines: [{ y: -180 }] });
        else if (what === "nyquist") found.set(kind, { ...common, title: t("panel.nyquist"), x: { label: "Re", unit: "" }, y: { label: "Im", unit: "" }, equal: true, clamp: [-3, 3], keep: [[-1, 0], [0, 0]], lines: [{ x: -1 }, { y: 0 }], ...(loop ? { circle: 1 } : {}) });
        else if (what === "nichols") found.set(kind, { ...common, title: t("panel.nichols"), x: { label: t("panel.phaseShort"), unit: "°" }, y: { label: t("panel.magnitudeShort"), unit: "dB" }, free: true, clamp: [-40, 60], clampX: [-720, 360], keep: [[-210, -12], [-90, 12]], lines: [{ x: -180 }, { x: -540 }, { x: 180 }, { y: 0 }], ...(loop ? { chart: nicholsChart } : {}) });
        else if (what === "poles") found.set(kind, { ...common, series: [...series.map((s) => ({ ...s, marks: "cross" as const })), ...(locusLabel ? [{ label: locusLabel, color: dark ? MEASURED.dark : MEASURED.light, dash: [], width: 1.2 }] : [])], chart: dampingGrid, title: t("panel.poles"), x: { label: "Re", unit: "1/s" }, y: { label: "Im", unit: "rad/s" }, equal: true, keep: [[0, 0]], lines: [{ x: 0 }, { y: 0 }] });
      }
      return found;
    }, [opened, plots.join(), series, recorded, loop, locusLabel, dark, t]);
    const line = useMemo(() => locus && curveOf(locus.locus), [locus]);
    /** The branch that is held, or was last. */
    const branch = useRef<number | null>(null);
    /** The frequency at which a curve is held while it is pulled. */
    const held = useRef<number | null>(null);
    const moving = useRef<{ frequency: Float32Array; magnitude: Float32Array; phase: Float32Array; grip: number | null } | null>(null);

    const draw = (next: Frame) => {
      frame.current = next;
      if (next.variants.length !== variants.length) return;
      const every: { frame: Frame; index: number }[] = [...next.variants.map((_, index) => ({ frame: next, index })), ...Array.from({ length: GHOSTS }, (_, i) => ({ frame: ghosts.current[i] ?? next, index: ghosts.current[i] ? 0 : -1 }))];
      const responses = new Map<number, ReturnType<typeof bode>>();
      const bodeOf = (k: number) => {
        const known = responses.get(k);
        if (known) return known;
        const { re, im } = every[k]!.frame.response(every[k]!.index);
        const made = bode(re, im);
        responses.set(k, made);
        return made;
      };
      const margins = loop && variants[0]?.kind === "current" && next.frequency.length > 1 ? marginsOf(next.frequency, bodeOf(0).magnitude, bodeOf(0).phase) : null;
      const seen = goals.length > 0 ? factsOf(next, opened.curves.indexOf(output), margins, next.frequency.length > 1 ? bodeOf(0).magnitude : null) : null;
      facts.current = seen;
      const own = pull && variants[0]?.kind === "current" && next.frequency.length > 1 ? { frequency: next.frequency, ...bodeOf(0) } : null;
      moving.current = own && { ...own, grip: gripAt(own, margins) };
      const step = (next.time[next.time.length - 1]! - next.time[0]!) / Math.max(1, next.time.length - 1);
      // Where there is no list of poles, with a delay, there are no lines of them.
      const listed = next.poles(0).re.some(Number.isFinite);
      for (const kind of specs.keys()) {
        const handle = handles.current.get(kind);
        if (!handle) continue;
        const [what, name] = kind.split(":");
        const place = opened.curves.indexOf(name ?? "");
        const x = what === "step" ? next.time : what === "spectrum" ? frequenciesOf(next.time.length, step) : next.frequency;
        const curves = every.map(({ frame: from, index }, k): Curve => {
          if (what === "nyquist" || what === "poles") {
            if (index < 0) return EMPTY;
            const { re, im } = what === "nyquist" ? from.response(index) : from.poles(index);
            return { x: re, y: im };
          }
          if (what === "nichols") return index < 0 ? EMPTY : { x: bodeOf(k).phase, y: bodeOf(k).magnitude };
          if (index < 0) return { x, y: new Float32Array(x.length).fill(NaN) };
          if (what === "step") return { x, y: from.outputs(index, place) };
          if (what === "spectrum") return { x, y: spectrumOf(from.outputs(index, place)) };
          return { x, y: what === "bode" ? bodeOf(k).magnitude : bodeOf(k).phase };
        });
        if (what === "poles" && line) curves.push(listed ? line : EMPTY);
        const overlays = recorded.filter((one) => one.output === name);
        if (what === "step" || what === "spectrum") for (const one of overlays) curves.push({ x, y: what === "step" ? one.values : one.spectrum });
        const bands = what === "step" ? overlays.map(({ low, high, series: { color } }): Band => ({ x, low, high, color })) : [];
        const decor = decorOf(what ?? "", name, bands, seen, margins, listed);
        handle.update(curves, decor);
        // In a Nyquist diagram a response of nothing is a point that nobody sees.
        const heights = what === "nyquist" ? next.variants.map((_, k) => bodeOf(k).magnitude) : curves.map(({ y }) => y);
        describe(kind, decor.marks, heights.some((height) => height.some(Number.isFinite)) ? "" : t(`panel.nothing.${what === "poles" && opened.nonlinear ? "nonlinearPoles" : what}`, ""));
      }
      holder.current?.setAttribute("data-frame", String(next.seq));
    };

    /** What is marked in a picture, for those who cannot see it; and for everybody, why there is nothing in it. */
    const describe = (kind: string, marks: Mark[], nothing: string) => {
      const text = nothing || marks.map((mark) => mark.text).join(", ");
      const picture = holder.current?.children[[...specs.keys()].indexOf(kind)]?.querySelector("[role=img]");
      if (!picture || (picture.getAttribute("aria-description") ?? "") === text) return;
      picture.setAttribute("aria-description", text);
      picture.toggleAttribute("data-empty", nothing !== "");
    };

    /** The grip on the root locus, at the pole of the present value. */
    const gripOf = (): Zone[] => {
      const value = locus?.value();
      if (!locus || value === undefined) return [];
      const held = branch.current !== null && branch.current < locus.locus.branches.length ? branch.current : dominant(locus.locus, value);
      const at = held === null ? null : poleAt(locus.locus, held, value);
      return at ? [{ id: LOCUS, shapes: [], handle: { at, axis: "both", label: locus.label, text: locus.text(value) } }] : [];
    };

    /** The grip on the moving curve: at its crossover, or where it is held. */
    const pullOf = (plane: Plane): Zone[] => {
      const at = held.current ?? moving.current?.grip ?? null;
      const point = !pull || !moving.current || at === null ? null : pointAt(moving.current, at, plane);
      return point ? [{ id: `${PULL}${plane}`, shapes: [], handle: { at: point, axis: "both", label: pull!.label, text: pull!.text(pull!.value()) } }] : [];
    };

    /** What lies behind the curves of one plot: forbidden zones, margins, error bands. */
    const decorOf = (what: string, name: string | undefined, bands: Band[], seen: Facts | null, margins: Margins | null, listed: boolean): Decor => {
      const marks = margins ? marksOf(what, margins) : [];
      const grips = what === "poles" ? (listed ? gripOf() : []) : PLANES.includes(what) ? pullOf(what as Plane) : [];
      const here = seen ? goals.filter((goal) => WANTED[goal.metric]?.plot === what && (name === undefined || name === (goal.output ?? output))) : [];
      if (here.length === 0 && marks.length === 0 && bands.length === 0 && grips.length === 0) return NOTHING;
      const zones = here.flatMap((goal) => {
        const { text, unit } = formatMetric(goal.metric, goal.value, WANTED_UNITS[goal.metric] ?? "");
        const metric = t(`metrics.${goal.metric}`, words(goal.metric));
        return zoneOf(goal, seen!, t("panel.zone", { metric }), `${metric} ${goal.bound === "upper" ? "≤" : "≥"} ${text} ${unit}`) ?? [];
      });
      return { zones: [...zones, ...grips], marks, bands };
    };

    const latest = useRef(draw);
    latest.current = draw;
    const forGoals = useRef({ goals, onGoal, locus, onLocus, pull, onPull });
    forGoals.current = { goals, onGoal, locus, onLocus, pull, onPull };
    const pulled = (plane: Plane, [x, y]: Point, done: boolean) => {
      const { pull: now, onPull: follow } = forGoals.current;
      const curve = moving.current;
      if (!now || !curve) return;
      const { frequency } = now.family;
      // In a Bode plot the curve follows to another frequency; in a plane it is the point of one frequency that moves.
      const at = plane === "bode" ? Math.min(frequency.at(-1)!, Math.max(frequency[0]!, x)) : (held.current ?? curve.grip);
      const drawn = at === null ? null : pointAt(curve, at, "nichols");
      if (at === null || !drawn) return;
      held.current = done ? null : at;
      const place = nearest(wayOf(now.family, at, plane, drawn[0]), [plane === "bode" ? 0 : x, y]);
      if (place) follow?.(place.value, done);
    };
    const onZone = useCallback((id: string, at: Point, done: boolean) => {
      const { locus: line, onLocus: follow } = forGoals.current;
      const place = id === LOCUS && line ? nearest(line.locus, at) : null;
      if (place) {
        branch.current = place.branch;
        follow?.(place.value, done);
      }
      if (id.startsWith(PULL)) pulled(id.slice(PULL.length) as Plane, at, done);
      const goal = forGoals.current.goals.find((one) => one.metric === id);
      if (goal && facts.current) forGoals.current.onGoal(id, boundAt(goal, at, facts.current), done);
    }, []);
    // A plot that has just come, or goals that have moved: the newest frame is drawn anew, once.
    const queued = useRef(false);
    const drawAnew = useCallback(() => {
      if (queued.current) return;
      queued.current = true;
      queueMicrotask(() => {
        queued.current = false;
        if (frame.current) latest.current(frame.current);
      });
    }, []);
    useEffect(() => {
      branch.current = null;
    }, [locus]);
    // Of other variants than there were, nothing is drawn yet.
    useEffect(() => {
      if (frame.current && frame.current.variants.length !== variants.length) holder.current?.removeAttribute("data-frame");
    }, [variants]);
    useEffect(drawAnew, [goals, output, loop, locus, pull, drawAnew]);
    const refs = useRef(new Map<string, (handle: PlotHandle | null) => void>());
    const refOf = (kind: string) => {
      const known = refs.current.get(kind);
      if (known) return known;
      const made = (handle: PlotHandle | null) => {
        if (handle) {
          handles.current.set(kind, handle);
          drawAnew();
        } else handles.current.delete(kind);
      };
      refs.current.set(kind, made);
      return made;
    };

    useImperativeHandle(ref, () => ({
      draw: (next) => latest.current(next),
      leaveGhost() {
        const now = frame.current;
        if (now) ghosts.current = [now, ...ghosts.current].slice(0, GHOSTS);
        setShadows(ghosts.current.length);
      },
      forget() {
        ghosts.current = [];
        setShadows(0);
        frame.current = null;
      },
    }), []);
    const dropShadows = useCallback(() => {
      ghosts.current = [];
      setShadows(0);
      drawAnew();
    }, [drawAnew]);

    return (
      <div ref={holder} className={classes.grid} data-testid="plots">
        {[...specs].map(([kind, spec]) => (
          <Plot key={kind} spec={spec} height={kind === "poles" && locus ? TALL : (height ?? (kind.startsWith("step") ? 250 : 230))} rows={kind === "poles" && locus ? 2 : 1} shadows={shadows} onDropShadows={dropShadows} summary={t("panel.summary", { title: spec.title, curves: labels.replaceAll(/(^|\|)[a-z]+:/g, "$1").replaceAll("|", ", ") })} onZone={onZone} ref={refOf(kind)} />
        ))}
      </div>
    );
  }),
);

/** SI units of the metrics that are drawn, where they have one. */
const WANTED_UNITS: Record<string, string> = { rise_time: "s", response_time: "s", settling_time: "s", bandwidth: "rad/s", phase_margin: "rad", gain_margin: "1" };

/** The margins of a loop, where each is read. */
function marksOf(what: string, { phase, gain }: Margins): Mark[] {
  const found: Mark[] = [];
  const degrees = phase ? `φm ${formatNumber(phase.at - phase.turn, 3)}°` : "";
  const decibel = gain ? `gm ${formatNumber(-gain.magnitude, 3)} dB` : "";
  if (what === "phase" && phase) found.push({ from: [phase.frequency, phase.turn], to: [phase.frequency, phase.at], text: degrees });
  if (what === "bode" && gain) found.push({ from: [gain.frequency, 0], to: [gain.frequency, gain.magnitude], text: decibel });
  if (what === "nichols") {
    if (phase) found.push({ from: [phase.turn, 0], to: [phase.at, 0], text: degrees });
    if (gain) found.push({ from: [gain.turn, 0], to: [gain.turn, gain.magnitude], text: decibel });
  }
  if (what === "nyquist") {
    if (phase) found.push({ from: [-1, 0], to: [Math.cos((phase.at * Math.PI) / 180), Math.sin((phase.at * Math.PI) / 180)], text: degrees });
    if (gain) found.push({ from: [-1, 0], to: [-(10 ** (gain.magnitude / 20)), 0], text: decibel });
  }
  return found;
}
