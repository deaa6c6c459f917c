import { Alert, Button, Group, Slider, Stack, Text, Title } from "@mantine/core";
import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useMemo } from "react";
import { useTranslation } from "react-i18next";
import { Link, useNavigate } from "react-router";
import { saveSystem, systemQuery } from "@/shared/api/systems";
import { compareAt } from "@/shared/systems/compared";
import { withValues } from "@/shared/systems/apply";
import { describedQuery } from "@/shared/systems/described";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { formatNumber } from "@/shared/units/format";
import { panelAt, type OptimizationResult } from "../results";
import { BeforeAfter } from "./BeforeAfter";
import { Certificate } from "./Certificate";
import { Convergence } from "./Convergence";
import { Findings } from "./Findings";
import { FrontView } from "./FrontView";
import { GoalTable } from "./GoalTable";
import { cellIn, placeIn, useLook } from "./look";
import { valuesAt } from "./map";
import { MapView } from "./MapView";
import { useAsked, useCandidate } from "./useCandidate";
import { Values } from "./Values";

/** What came out: the values, every goal before and after, the curves, the certificate; and what to do with it. */
export function OptimizationView({ id, result }: { id: string; result: OptimizationResult }) {
  const { t } = useTranslation();
  const navigate = useNavigate();
  const queries = useQueryClient();
  // Of several structures the best one may be another system than the one that was asked about.
  const asked = useAsked(id, true);
  const other = asked.data?.alternatives?.find(({ name }) => name === result.chosen)?.system;
  const found = result.chosen !== undefined && !asked.data ? null : typeof other === "string" ? { id: other } : result.system;
  const system = useQuery({ ...systemQuery(found?.id ?? ""), enabled: found !== null });
  const described = useQuery({ ...describedQuery(found?.id ?? "", system.data?.revision ?? 0), enabled: system.isSuccess });
  const steps = result.history.filter((step) => step.variables);
  const { query, look } = useLook();
  const step = placeIn(query.get("step"), steps.length);
  const point = placeIn(query.get("point"), result.front?.length ?? 0);
  const cell = result.map ? cellIn(query.get("cell"), result.map) : null;
  // A map says nothing of variables that are tied to others.
  const whole = result.map !== null && result.map !== undefined && Object.keys(result.best).every((name) => name in result.map!.axes);
  const at: { label: string; title: string; values: Record<string, number> } | null =
    point !== null
      ? { label: t("jobs.point", { number: point + 1 }), title: t("jobs.point", { number: point + 1 }), values: result.front![point]!.parameters }
      : cell !== null && whole
        ? { label: t("jobs.onTheMap"), title: t("jobs.valuesOnMap"), values: valuesAt(result.map!, cell) }
        : step !== null
          ? { label: t("jobs.after", { evaluation: steps[step]!.evaluation }), title: t("jobs.valuesAt", { evaluation: steps[step]!.evaluation }), values: steps[step]!.variables! }
          : null;
  const place = `${point}|${cell?.join()}|${step}`;
  const between = useMemo(() => at, [place, t, result]);
  const values = between?.values ?? result.best;
  const path = useMemo(() => result.history.slice(0, step === null ? undefined : result.history.indexOf(steps[step]!) + 1).flatMap((past) => (past.variables ? [past.variables] : [])), [result, step]);
  const { candidate, stale, error } = useCandidate(id, result.goals, between?.values ?? null);
  const label = between?.label ?? "";
  const drawn = useMemo(() => (candidate && label ? { label, curves: candidate.curves } : null), [candidate, label]);
  const units = useMemo(() => new Map((described.data?.parameters ?? []).map((p) => [p.path, p.unit])), [described.data]);
  const outputs = useMemo(() => new Map((described.data?.outputs ?? []).map((output) => [output.name, output.unit])), [described.data]);
  const infos = new Map((described.data?.parameters ?? []).map((p) => [p.path, p]));
  const save = useMutation({
    mutationFn: () => saveSystem(found!.id, withValues(system.data!.document, Object.fromEntries(Object.entries(values).filter(([path]) => infos.has(path)).map(([path, value]) => [path, { value, unit: infos.get(path)!.unit }]))), system.data!.etag, id),
    onSuccess: async () => {
      await queries.invalidateQueries({ queryKey: ["system", found!.id] });
      void navigate(`/systems/${found!.id}/revisions`);
    },
  });
  const good = result.status === "converged";
  return (
    <Stack gap="lg" data-testid="optimum">
      <Alert color={good ? "green" : "orange"} variant="outline" title={t(`jobs.outcome.${result.status}`, result.status)}>
        {result.advice.charAt(0).toUpperCase() + result.advice.slice(1)}
      </Alert>
      <section>
        <Title order={2} mb="xs">
          {between?.title ?? t("jobs.values")}
        </Title>
        <Values values={values} parameters={infos} variables={asked.data?.variables} />
        {found && (
          <Group gap="xs">
            <Button component={Link} to={panelAt(found.id, values)}>
              {t("jobs.toPanel")}
            </Button>
            {result.system?.id === found.id && (
              <Button variant="default" component={Link} to={compareAt([{ kind: "revision", ...result.system }, { kind: "job", id }])}>
                {t("compare.withStart", { number: result.system.revision })}
              </Button>
            )}
            {system.data && described.data && (
              <Button variant="default" onClick={() => save.mutate()} loading={save.isPending}>
                {t("panel.save")}
              </Button>
            )}
          </Group>
        )}
        <ProblemAlert error={save.error} />
      </section>
      <section>
        <Title order={2} mb="xs">
          {t("jobs.goals")}
        </Title>
        <GoalTable goals={result.goals} between={between && { label: between.label, goals: candidate?.goals ?? [], stale }} />
        <ProblemAlert error={error} />
        <Certificate result={result} />
      </section>
      <Findings result={result} />
      <BeforeAfter before={result.curves.before} after={result.curves.after} units={outputs} between={drawn} />
      {steps.length > 1 && (
        <section>
          <Title order={2} mb="xs">
            {t("jobs.course")}
          </Title>
          <Convergence points={result.history.flatMap((h) => (h.objective === null ? [] : [{ evaluation: h.evaluation, objective: h.objective, violation: h.violation ?? 0 }]))} />
          <Text fz="xs" mt="xs">
            {step === null ? t("jobs.scrub") : t("jobs.atStep", { evaluation: steps[step]!.evaluation, objective: formatNumber(steps[step]!.objective ?? NaN, 4) })}
          </Text>
          <Slider min={0} max={steps.length - 1} value={step ?? steps.length - 1} onChange={(next) => look("step", next === steps.length - 1 ? null : String(next))} thumbLabel={t("jobs.scrub")} maw={600} label={(v) => steps[v]?.evaluation} />
        </section>
      )}
      {result.map && Object.keys(result.map.axes).length > 1 && <MapView map={result.map} values={values} path={path} units={units} chosen={whole ? cell : null} {...(whole ? { onChoose: (next: number[] | null) => look("cell", next?.join() ?? null) } : {})} />}
      {result.front && result.front.length > 0 && <FrontView front={result.front} goals={result.goals} variables={Object.keys(result.best)} knee={result.knee ?? null} units={units} selected={point} onSelect={(place) => look("point", String(place))} />}
    </Stack>
  );
}
