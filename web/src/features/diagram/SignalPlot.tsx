import { CloseButton, useComputedColorScheme } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useMemo } from "react";
import { useTranslation } from "react-i18next";
import { api, atOnce } from "@/shared/api/client";
import type { components } from "@/shared/api/schema";
import type { SystemDocument } from "@/shared/api/types";
import { stroke } from "@/shared/plots/palette";
import { Plot } from "@/shared/plots/Plot";
import type { PlotSpec } from "@/shared/plots/types";
import { describedDocument } from "@/shared/systems/described";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { prettyUnit } from "@/shared/units/format";

/** What travels along a connection, in a subsystem too (`inner.motor.position`), when the first input makes a step. */
export function SignalPlot({ document, from, onClose }: { document: SystemDocument; from: string; onClose(): void }) {
  const { t } = useTranslation();
  const dark = useComputedColorScheme("light") === "dark";
  const port = Object.keys(document.blocks).find((name) => document.blocks[name]!.kind === "input");
  const asked = useMemo(() => ({ ...document, outputs: { signal: from } }), [document, from]);
  const unit = prettyUnit(useQuery(describedDocument(asked)).data?.outputs[0]?.unit ?? "");
  const reply = useQuery({
    queryKey: ["signal", from, JSON.stringify(document)],
    enabled: port !== undefined,
    retry: false,
    queryFn: () =>
      atOnce(api.POST("/v1/simulations", { body: { system: asked, input: { port, signal: { kind: "step" } }, samples: 500, metrics: [] } as unknown as components["schemas"]["SimulationRequest"] })),
  });
  const spec = useMemo<PlotSpec>(() => ({ title: t("diagram.signalOf", { from }), x: { label: t("panel.time"), unit: "s" }, y: { label: from, unit }, series: [{ label: from, ...stroke(0, dark), width: 2 }], dark }), [from, unit, dark, t]);
  const variant = reply.data?.variants[0];
  const curves = useMemo(() => (variant ? [{ x: Float64Array.from(variant.time as number[]), y: Float64Array.from((variant.outputs.signal ?? []) as (number | null)[], (v) => v ?? NaN) }] : undefined), [variant]);
  return (
    <div style={{ position: "relative" }}>
      <CloseButton size="sm" aria-label={t("diagram.closeSignal")} onClick={onClose} style={{ position: "absolute", right: 34, top: 2, zIndex: 2 }} />
      {reply.isError && <ProblemAlert error={reply.error} />}
      {curves && <Plot spec={spec} curves={curves} height={180} summary={t("diagram.signalOf", { from })} />}
    </div>
  );
}
