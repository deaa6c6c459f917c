import { Text, Title } from "@mantine/core";
import { useCallback, useEffect, useMemo, useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import { holds } from "@/shared/responses/goals";
import { ResponsePlots, type PlotsHandle } from "@/shared/responses/ResponsePlots";
import { useLive } from "@/shared/responses/useLive";
import { Busy } from "@/shared/ui/Busy";
import type { Part } from "./form";
import { drawnGoals } from "./drawn";
import { changed } from "./form";
import classes from "./SearchForm.module.css";

/** Parameters that the live channel takes at most. */
const MOST = 50;

/** What the search begins with, as it is filled in: the response, Bode and Nyquist, the goals as zones whose edges can be dragged. */
export function Preview({ id, revision, form, opened: known, loops, metrics, change }: Part & { id: string; revision: number }) {
  const { t } = useTranslation();
  const experiment = form.experiments[0];
  const inTime = form.goals.find(({ metric }) => (metrics.get(metric)?.domain ?? "time") === "time" && metric !== "control_effort");
  const output = known.outputs.find(({ name }) => name === inTime?.output)?.name ?? known.outputs[0]?.name ?? "";
  const loop = form.goals.find(({ metric, loop: own }) => metrics.get(metric)?.domain === "loop" && loops.includes(own))?.loop ?? loops[0];
  const rows = drawnGoals(form.goals, output);
  const vectors = new Map(known.parameters.map(({ path, value }) => [path, value]));
  const paths = form.variables.filter(({ parameter, chosen }) => chosen !== "tied" && vectors.has(parameter)).map(({ parameter }) => parameter);
  const vector = form.variables.filter(({ parameter }) => paths.includes(parameter)).map(({ parameter, start }) => (typeof start === "number" ? start : vectors.get(parameter)!));
  const plots = useRef<PlotsHandle>(null);
  const live = useLive(
    {
      system: id,
      parameters: [...new Set(paths)].slice(0, MOST),
      ...(experiment ? { input: experiment.commands.length === 1 ? experiment.commands[0] : experiment.commands } : {}),
      ...(output ? { output } : {}),
      ...(loop ? { frequency: { open_at: loop } } : { frequency: { from: experiment?.commands[0]?.port ?? known.inputs[0], to: output } }),
      metrics: rows.filter(({ output: other }) => other === undefined).map(({ metric }) => metric),
      duration: experiment?.duration ?? "auto",
    },
    useCallback((frame) => requestAnimationFrame(() => plots.current?.draw(frame)), []),
    revision,
  );
  const values = JSON.stringify(vector.slice(0, MOST));
  const set = useRef(live.set);
  set.current = live.set;
  useEffect(() => {
    if (live.opened) set.current([JSON.parse(values) as number[]], 1);
  }, [live.opened, values]);

  const [dragged, setDragged] = useState<{ metric: string; value: number } | null>(null);
  const goals = rows.map((goal) => (goal.metric === dragged?.metric ? { ...goal, value: dragged.value } : goal));
  const drawn = useMemo(() => goals, [JSON.stringify(goals)]);
  const latest = useRef({ form, rows, change });
  latest.current = { form, rows, change };
  const onGoal = useCallback((metric: string, at: number, done: boolean) => {
    const value = Number(at.toPrecision(3));
    setDragged(done ? null : { metric, value });
    const { form: now, rows: places, change: put } = latest.current;
    const place = places.find((goal) => goal.metric === metric);
    if (done && place) put({ goals: changed(now.goals, place.row, { [place.bound]: value }) });
  }, []);
  const shown = live.opened;
  const effort = rows.find((goal) => goal.output !== undefined)?.output;
  const kinds = useMemo(() => [`step:${output}`, ...(effort ? [`step:${effort}`] : []), "bode", ...(loop ? ["nyquist"] : ["phase"])], [output, effort, loop]);
  const variants = useMemo(() => [{ label: t("optimise.atStart"), kind: "current" as const }], [t]);
  const measured = live.measured.get(0)?.metrics ?? {};
  const missed = rows.filter((goal) => holds(goal, measured[goal.metric]?.value) === false).length;
  return (
    <section className={classes.preview} aria-label={t("optimise.preview")} data-testid="preview">
      <Title order={2}>{t("optimise.preview")}</Title>
      <Text fz="sm" c="dimmed" mb="xs">
        {t("optimise.previewDoc")} {missed > 0 && t("optimise.missed", { count: missed })}
      </Text>
      {live.problem && (
        <Text fz="sm" role="status">
          {t("optimise.noPreview", { detail: live.problem.document.detail })}
        </Text>
      )}
      {!shown && !live.problem && <Busy>{t("panel.opening")}</Busy>}
      {shown && <ResponsePlots ref={plots} opened={shown} plots={kinds} variants={variants} goals={drawn} output={output} loop={loop !== undefined} height={170} onGoal={onGoal} />}
    </section>
  );
}
