import { useComputedColorScheme } from "@mantine/core";
import { useMemo } from "react";
import { useTranslation } from "react-i18next";
import { Pairs } from "@/shared/plots/Pairs";
import { stroke } from "@/shared/plots/palette";
import { Plot } from "@/shared/plots/Plot";
import type { PlotSpec } from "@/shared/plots/types";
import { prettyUnit, words } from "@/shared/units/format";
import { numbersOf, type Curves } from "../results";

interface Props {
  before: Record<string, Curves>;
  after: Record<string, Curves>;
  /** Of the outputs, SI. */
  units: Map<string, string>;
  /** A step of the search or a point of the front between the two. */
  between?: { label: string; curves: Record<string, Curves> } | null;
}

/** Every output of every experiment, before and after, and at the step that is looked at. */
export function BeforeAfter({ before, after, units, between = null }: Props) {
  const { t } = useTranslation();
  const dark = useComputedColorScheme("light") === "dark";
  const plots = useMemo(
    () =>
      Object.entries(after).flatMap(([experiment, curves]) =>
        Object.keys(curves.outputs).map((output) => {
          const drawn = [
            { label: t("revisions.before"), curves: before[experiment], ...stroke(1, dark), width: 1.4 },
            ...(between ? [{ label: between.label, curves: between.curves[experiment], ...stroke(2, dark), width: 2.4 }] : []),
            { label: t("revisions.after"), curves, ...stroke(0, dark), width: between ? 1.4 : 2.4 },
          ];
          const spec: PlotSpec = { title: `${words(output)} (${experiment})`, x: { label: t("panel.time"), unit: "s" }, y: { label: words(output), unit: prettyUnit(units.get(output) ?? "") }, series: drawn.map(({ label, color, dash, width }) => ({ label, color, dash, width })), dark };
          const x = numbersOf(curves.time);
          // All on the times of the last: uPlot's series share theirs.
          const at = (own: Curves | undefined) => (own === curves ? numbersOf(own.outputs[output]!) : own?.outputs[output] ? resampled(numbersOf(own.time), numbersOf(own.outputs[output]), x) : new Float64Array(x.length).fill(NaN));
          return { spec, curves: drawn.map((one) => ({ x, y: at(one.curves) })) };
        }),
      ),
    [before, after, units, between, dark, t],
  );
  return (
    <Pairs>
      {plots.map(({ spec, curves }) => (
        <Plot key={spec.title} spec={spec} curves={curves} height={220} summary={spec.title} />
      ))}
    </Pairs>
  );
}

/** A curve at other times, straight between its points; after its end its last value, where it has come to rest. */
export function resampled(time: Float64Array, values: Float64Array, at: Float64Array): Float64Array {
  const found = new Float64Array(at.length);
  let k = 0;
  for (let i = 0; i < at.length; i++) {
    const t = at[i]!;
    while (k + 1 < time.length && time[k + 1]! < t) k++;
    const next = Math.min(k + 1, time.length - 1);
    const span = time[next]! - time[k]!;
    const part = span > 0 ? Math.min(1, Math.max(0, (t - time[k]!) / span)) : 0;
    found[i] = values[k]! + part * (values[next]! - values[k]!);
  }
  return found;
}
