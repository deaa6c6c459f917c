import { Title } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useCallback, useEffect, useMemo, useRef } from "react";
import { useTranslation } from "react-i18next";
import type { Opened } from "@/shared/live/protocol";
import { ResponsePlots, type PlotsHandle } from "@/shared/responses/ResponsePlots";
import { useLive } from "@/shared/responses/useLive";
import { describedQuery } from "@/shared/systems/described";
import type { Asked } from "./candidate";
import { useAsked } from "./useCandidate";
import { Values } from "./Values";

const NO_GOALS: never[] = [];
const NOWHERE = () => undefined;

/** The best values so far with their response, Bode and Nyquist, beside those of the stored system, as the search goes on. */
export function BestSoFar({ job, system, values }: { job: string; system: { id: string; revision: number }; values: Record<string, number> }) {
  const { t } = useTranslation();
  const asked = useAsked(job, true).data;
  const described = useQuery(describedQuery(system.id, system.revision)).data;
  const parameters = useMemo(() => new Map((described?.parameters ?? []).map((p) => [p.path, p])), [described]);
  return (
    <section data-testid="best-so-far" data-values={JSON.stringify(values)}>
      <Title order={2} mb="xs">
        {t("jobs.bestSoFar")}
      </Title>
      <Values values={values} parameters={parameters} variables={asked?.variables} />
      {/* What several structures have in common is not known, nor what their values are of. */}
      {asked && described && !asked.alternatives?.length && <Responses asked={asked} described={described} revision={system.revision} values={values} />}
    </section>
  );
}

function Responses({ asked, described, revision, values }: { asked: Asked; described: Opened; revision: number; values: Record<string, number> }) {
  const { t } = useTranslation();
  const plots = useRef<PlotsHandle>(null);
  const known = new Map(described.parameters.map((p) => [p.path, p]));
  const paths = Object.keys(values).filter((path) => known.get(path)?.bound === false);
  const experiment = asked.experiments?.[0];
  const output = asked.goals.find((goal) => goal.output && goal.metric !== "control_effort")?.output ?? described.outputs[0]?.name ?? "";
  const loop = asked.goals.find((goal) => goal.open_at)?.open_at;
  const live = useLive(
    {
      system: asked.system,
      parameters: paths,
      ...(experiment ? { input: experiment.input } : {}),
      ...(output ? { output } : {}),
      ...(loop ? { frequency: { open_at: loop } } : { frequency: { from: described.inputs[0], to: output } }),
      duration: experiment?.duration ?? "auto",
    },
    useCallback((frame) => requestAnimationFrame(() => plots.current?.draw(frame)), []),
    revision,
  );
  const vectors = JSON.stringify([paths.map((path) => values[path]!), paths.map((path) => known.get(path)!.value)]);
  const set = useRef(live.set);
  set.current = live.set;
  useEffect(() => {
    if (live.opened && paths.length > 0) set.current(JSON.parse(vectors) as number[][], 0);
  }, [live.opened, vectors]);
  const kinds = useMemo(() => [`step:${output}`, "bode", loop ? "nyquist" : "phase"], [output, loop]);
  const variants = useMemo(() => [{ label: t("jobs.best"), kind: "current" as const }, { label: t("revisions.before"), kind: "reference" as const }], [t]);
  if (!live.opened || paths.length === 0) return null;
  return <ResponsePlots ref={plots} opened={live.opened} plots={kinds} variants={variants} goals={NO_GOALS} output={output} loop={loop != null} height={200} onGoal={NOWHERE} />;
}
