import { useComputedColorScheme } from "@mantine/core";
import { forwardRef, useImperativeHandle, useMemo, useRef } from "react";
import { useTranslation } from "react-i18next";
import { bode, type Frame, type Opened } from "@/shared/live/protocol";
import { Plot, type PlotHandle } from "@/shared/plots/Plot";
import { stroke } from "@/shared/plots/palette";
import type { Curve, PlotSpec, Series } from "@/shared/plots/types";
import { prettyUnit, words } from "@/shared/units/format";
import classes from "./PanelPlots.module.css";
import type { Variant } from "./state";

export interface PlotsHandle {
  draw(frame: Frame): void;
  /** Leaves the moving curves of now behind as a shadow. */
  leaveGhost(): void;
  forget(): void;
}

interface Props {
  opened: Opened;
  plots: string[];
  variants: Pick<Variant, "label" | "kind">[];
}

const GHOSTS = 2;
const NOTHING: Curve = { x: [], y: [] };

/** All plots of a front panel, drawn from frames as they come, without React. */
export const PanelPlots = forwardRef<PlotsHandle, Props>(function PanelPlots({ opened, plots, variants }, ref) {
  const { t } = useTranslation();
  const dark = useComputedColorScheme("light") === "dark";
  const handles = useRef(new Map<string, PlotHandle>());
  const frame = useRef<Frame | null>(null);
  const ghosts = useRef<Frame[]>([]);
  const holder = useRef<HTMLDivElement>(null);
  const labels = variants.map((v) => `${v.kind}:${v.label}`).join("|");

  const series = useMemo<Series[]>(() => {
    const own = variants.map((variant, i): Series => ({ label: variant.label, ...stroke(i, dark), width: variant.kind === "current" ? 2.4 : 1.5 }));
    const grey = dark ? "#c4cad0" : "#5b6269";
    const shadows = Array.from({ length: GHOSTS }, (_, i): Series => ({ label: t("panel.ghost", { number: i + 1 }), color: grey, dash: i === 0 ? [1, 3] : [1, 6], faint: true }));
    return [...own, ...shadows];
    // The labels say all that matters of the variants.
  }, [labels, dark, t]);

  const specs = useMemo(() => {
    const units = new Map(opened.outputs.map((o) => [o.name, prettyUnit(o.unit)]));
    const frequency = { label: "ω", unit: "rad/s", log: true };
    const found = new Map<string, PlotSpec>();
    for (const kind of plots) {
      const [what, output] = kind.split(":");
      const common = { series, dark };
      if (what === "step" && output && units.has(output)) found.set(kind, { ...common, title: words(output), x: { label: t("panel.time"), unit: "s" }, y: { label: words(output), unit: units.get(output)! } });
      else if (what === "bode") found.set(kind, { ...common, title: t("panel.magnitude"), x: frequency, y: { label: t("panel.magnitudeShort"), unit: "dB" }, clamp: [-80, 120], lines: [{ y: 0 }] });
      else if (what === "phase") found.set(kind, { ...common, title: t("panel.phase"), x: frequency, y: { label: t("panel.phaseShort"), unit: "°" }, lines: [{ y: -180 }] });
      else if (what === "nyquist") found.set(kind, { ...common, title: t("panel.nyquist"), x: { label: "Re", unit: "" }, y: { label: "Im", unit: "" }, equal: true, clamp: [-3, 3], keep: [[-1, 0], [0, 0]], lines: [{ x: -1 }, { y: 0 }] });
      else if (what === "poles") found.set(kind, { ...common, series: series.map((s) => ({ ...s, marks: "cross" as const })), title: t("panel.poles"), x: { label: "Re", unit: "1/s" }, y: { label: "Im", unit: "rad/s" }, equal: true, keep: [[0, 0]], lines: [{ x: 0 }, { y: 0 }] });
    }
    return found;
  }, [opened, plots.join(), series, dark, t]);

  const draw = (next: Frame) => {
    frame.current = next;
    const moving = next.variants.length;
    if (moving !== variants.length) return;
    const every: { frame: Frame; index: number }[] = [...next.variants.map((_, index) => ({ frame: next, index })), ...Array.from({ length: GHOSTS }, (_, i) => ({ frame: ghosts.current[i] ?? next, index: ghosts.current[i] ? 0 : -1 }))];
    const phases = new Map<number, ReturnType<typeof bode>>();
    const bodeOf = (k: number) => {
      const { frame: from, index } = every[k]!;
      const { re, im } = from.response(index);
      const made = phases.get(k) ?? bode(re, im);
      phases.set(k, made);
      return made;
    };
    for (const kind of specs.keys()) {
      const [what, output] = kind.split(":");
      const aligned = what === "step" || what === "bode" || what === "phase";
      const place = opened.curves.indexOf(output ?? "");
      const curves = every.map(({ frame: from, index }, k): Curve => {
        const x = what === "step" ? next.time : next.frequency;
        if (index < 0) return aligned ? { x, y: new Float32Array(x.length).fill(NaN) } : NOTHING;
        if (what === "step") return { x, y: from.outputs(index, place) };
        if (what === "bode") return { x, y: bodeOf(k).magnitude };
        if (what === "phase") return { x, y: bodeOf(k).phase };
        const { re, im } = what === "nyquist" ? from.response(index) : from.poles(index);
        return { x: re, y: im };
      });
      handles.current.get(kind)?.update(curves);
    }
    holder.current?.setAttribute("data-frame", String(next.seq));
  };

  useImperativeHandle(ref, () => ({
    draw,
    leaveGhost() {
      const now = frame.current;
      if (now) ghosts.current = [now, ...ghosts.current].slice(0, GHOSTS);
    },
    forget() {
      ghosts.current = [];
      frame.current = null;
    },
  }));

  return (
    <div ref={holder} className={classes.grid} data-testid="plots">
      {[...specs].map(([kind, spec]) => (
        <Plot
          key={kind}
          spec={spec}
          height={kind.startsWith("step") ? 250 : 230}
          summary={t("panel.summary", { title: spec.title, curves: variants.map((v) => v.label).join(", ") })}
          ref={(handle) => {
            if (handle) {
              handles.current.set(kind, handle);
              if (frame.current) queueMicrotask(() => frame.current && draw(frame.current));
            } else handles.current.delete(kind);
          }}
        />
      ))}
    </div>
  );
});
