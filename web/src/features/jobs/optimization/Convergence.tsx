import { useComputedColorScheme } from "@mantine/core";
import { useMemo } from "react";
import { useTranslation } from "react-i18next";
import { stroke } from "@/shared/plots/palette";
import { Plot } from "@/shared/plots/Plot";
import type { PlotSpec } from "@/shared/plots/types";
import type { Best } from "../events";

/** The best objective so far over the evaluations. */
export function Convergence({ points }: { points: Best[] }) {
  const { t } = useTranslation();
  const dark = useComputedColorScheme("light") === "dark";
  const spec = useMemo<PlotSpec>(() => ({ title: t("jobs.convergence"), x: { label: t("jobs.evaluations"), unit: "", log: true }, y: { label: t("jobs.objective"), unit: "" }, series: [{ label: t("jobs.best"), ...stroke(0, dark), width: 2 }], dark }), [dark, t]);
  const curves = useMemo(() => [{ x: points.map((p) => Math.max(1, p.evaluation)), y: points.map((p) => p.objective) }], [points]);
  return (
    <div data-testid="convergence" data-points={points.length}>
      <Plot spec={spec} curves={curves} height={200} summary={t("jobs.convergence")} />
    </div>
  );
}
