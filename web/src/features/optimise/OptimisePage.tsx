import { ActionIcon, Button, CopyButton, Group, NativeSelect, Stack, Table, Text, Textarea, Title } from "@mantine/core";
import { useMutation, useQuery } from "@tanstack/react-query";
import { useEffect, useState } from "react";
import { useTranslation } from "react-i18next";
import { useNavigate, useParams, useSearchParams } from "react-router";
import { methodsQuery, metricsQuery } from "@/shared/api/catalogue";
import { api, must } from "@/shared/api/client";
import { Problem } from "@/shared/api/problem";
import type { components } from "@/shared/api/schema";
import { systemQuery } from "@/shared/api/systems";
import { describedQuery } from "@/shared/systems/described";
import { loopsOf } from "@/shared/systems/loops";
import { firstSliders } from "@/shared/systems/movable";
import { NumberEntry } from "@/shared/ui/NumberEntry";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { prettyUnit, words } from "@/shared/units/format";
import type { GoalRow, ProblemForm, VariableRow } from "@/shared/systems/search";
import { bodyOf, curlOf, pythonOf, readScenarios } from "./problem";

/** What may be chosen, what is wanted, and how it is searched for; the form is made from the catalogue. */
export function OptimisePage() {
  const { t } = useTranslation();
  const { id = "" } = useParams();
  const navigate = useNavigate();
  const system = useQuery(systemQuery(id)).data!;
  const described = useQuery(describedQuery(id, system.revision));
  const metrics = useQuery(metricsQuery).data;
  const methods = useQuery(methodsQuery).data;
  const [query, setQuery] = useSearchParams();
  const [form, setForm] = useState<ProblemForm | null>(null);
  const opened = described.data;
  const loops = loopsOf(system.document);

  // The address holds the form; a first visit is given one that makes sense for most loops.
  useEffect(() => {
    if (!opened || form) return;
    const kept = query.get("f");
    if (kept) {
      try {
        setForm(JSON.parse(kept) as ProblemForm);
        return;
      } catch {
        setQuery({}, { replace: true });
      }
    }
    const output = opened.outputs[0]?.name ?? "";
    const known = new Map(opened.parameters.map((p) => [p.path, p]));
    setForm({
      input: opened.inputs[0] ?? "",
      amplitude: 1,
      loop: loops[0] ?? "",
      variables: firstSliders(opened.parameters, 3).map((parameter): VariableRow => {
        const { lower, upper, value } = known.get(parameter)!;
        const wide = (bound: number | null) => bound === null || bound === 0 || Math.abs(bound) > 100 * Math.abs(value);
        return { parameter, lower: wide(lower) ? Number((value > 0 ? value / 10 : value * 10).toPrecision(3)) : lower!, upper: wide(upper) ? Number((value > 0 ? value * 10 : value / 10).toPrecision(3)) : upper! };
      }),
      goals: [
        { metric: "response_time", output, sense: "minimize" },
        { metric: "overshoot", output, sense: "", upper: 0.05 },
        ...(loops.length > 0 ? [{ metric: "sensitivity_peak", output, sense: "" as const, upper: 2 }] : []),
      ],
      scenarios: "",
      method: "auto",
      options: {},
    });
  }, [opened, form, query, setQuery, loops]);
  const change = (part: Partial<ProblemForm>) => {
    if (!form) return;
    const next = { ...form, ...part };
    setForm(next);
    setQuery({ f: JSON.stringify(next) }, { replace: true });
  };
  const submit = useMutation({
    mutationFn: async () => {
      if (readScenarios(form!.scenarios) === undefined) throw new Problem({ status: 422, title: "", detail: t("optimise.badScenario"), errors: [{ pointer: "/scenarios", detail: t("optimise.badScenario") }] });
      return must(api.POST("/v1/optimizations", { body: bodyOf(form!, id, domains) as components["schemas"]["OptimizationRequest"] }));
    },
    onSuccess: (job) => void navigate(`/jobs/${job.id}`),
  });
  if (described.isError) return <ProblemAlert error={described.error} m="md" onRetry={() => void described.refetch()} />;
  if (!form || !opened || !metrics || !methods) return null;
  const domains = { get: (name: string) => metrics.get(name)?.domain };
  const problem = submit.error instanceof Problem ? submit.error : null;
  const shownPlaces = [...form.variables.map((_, i) => `/variables/${i}`), ...form.goals.map((_, i) => `/goals/${i}`), "/scenarios"];
  const free = opened.parameters.filter((p) => !p.bound);
  const units = new Map(opened.parameters.map((p) => [p.path, p.unit]));
  const method = methods.find((m) => m.kind === form.method);
  const body = bodyOf(form, id, domains);
  const variable = (i: number, part: Partial<VariableRow>) => change({ variables: form.variables.map((row, k) => (k === i ? { ...row, ...part } : row)) });
  const goal = (i: number, part: Partial<GoalRow>) => change({ goals: form.goals.map((row, k) => (k === i ? { ...row, ...part } : row)) });
  const fault = (pointer: string) =>
    problem?.at(pointer) && (
      <Text fz="xs" c="var(--mantine-color-error)" role="alert">
        {problem.at(pointer)}
      </Text>
    );

  return (
    <div className="page">
      <form
        onSubmit={(event) => {
          event.preventDefault();
          submit.mutate();
        }}
      >
        <Stack gap="lg">
          <ProblemAlert error={submit.error} shown={shownPlaces} />
          <section>
            <Title order={2}>{t("optimise.variables")}</Title>
            <Text fz="sm" c="dimmed" mb="xs">
              {t("optimise.variablesDoc")}
            </Text>
            <Table maw={760}>
              <Table.Tbody>
                {form.variables.map((row, i) => (
                  <Table.Tr key={i}>
                    <Table.Td>
                      <NativeSelect size="xs" aria-label={t("optimise.variable", { number: i + 1 })} value={row.parameter} data={free.map((p) => p.path)} onChange={(event) => variable(i, { parameter: event.currentTarget.value })} />
                      {fault(`/variables/${i}`)}
                    </Table.Td>
                    <Table.Td>
                      <NumberEntry aria-label={t("optimise.from", { name: row.parameter })} value={row.lower} unit={units.get(row.parameter)} optional placeholder={t("optimise.asDocument")} onCommit={(value) => variable(i, { lower: value })} />
                    </Table.Td>
                    <Table.Td>
                      <NumberEntry aria-label={t("optimise.to", { name: row.parameter })} value={row.upper} unit={units.get(row.parameter)} optional placeholder={t("optimise.asDocument")} onCommit={(value) => variable(i, { upper: value })} />
                    </Table.Td>
                    <Table.Td w={40}>
                      <ActionIcon variant="subtle" color="gray" aria-label={t("optimise.drop", { name: row.parameter })} onClick={() => change({ variables: form.variables.filter((_, k) => k !== i) })}>
                        ×
                      </ActionIcon>
                    </Table.Td>
                  </Table.Tr>
                ))}
              </Table.Tbody>
            </Table>
            <Button
              variant="default"
              mt="xs"
              onClick={() => {
                const next = free.find((p) => !form.variables.some((row) => row.parameter === p.path));
                if (next) change({ variables: [...form.variables, { parameter: next.path }] });
              }}
            >
              {t("optimise.addVariable")}
            </Button>
          </section>
          <section>
            <Title order={2}>{t("optimise.goals")}</Title>
            <Text fz="sm" c="dimmed" mb="xs">
              {t("optimise.goalsDoc")}
            </Text>
            <Group align="flex-end" mb="xs">
              <NativeSelect size="xs" label={t("panel.input")} value={form.input} data={opened.inputs} onChange={(event) => change({ input: event.currentTarget.value })} />
              <NumberEntry label={t("panel.amplitude")} value={form.amplitude} onCommit={(value) => typeof value === "number" && value !== 0 && change({ amplitude: value })} w={100} />
              {loops.length > 0 && <NativeSelect size="xs" label={t("influence.loop")} value={form.loop} data={loops} onChange={(event) => change({ loop: event.currentTarget.value })} />}
            </Group>
            <Table.ScrollContainer minWidth={620}>
              <Table maw={980}>
                <Table.Thead>
                  <Table.Tr>
                    <Table.Th>{t("influence.metric")}</Table.Th>
                    <Table.Th>{t("optimise.of")}</Table.Th>
                    <Table.Th>{t("optimise.sense")}</Table.Th>
                    <Table.Th>≥</Table.Th>
                    <Table.Th>≤</Table.Th>
                    <Table.Th aria-label={t("systems.actions")} />
                  </Table.Tr>
                </Table.Thead>
                <Table.Tbody>
                  {form.goals.map((row, i) => {
                    const entry = metrics.get(row.metric);
                    const unit = prettyUnit(entry?.unit ?? "") ? entry!.unit : "";
                    const own = entry?.domain === "time" || entry?.domain === "path";
                    return (
                      <Table.Tr key={i}>
                        <Table.Td>
                          <NativeSelect size="xs" aria-label={t("optimise.goal", { number: i + 1 })} title={entry?.definition} value={row.metric} data={[...metrics.values()].map((m) => ({ value: m.kind, label: t(`metrics.${m.kind}`, words(m.kind)) }))} onChange={(event) => goal(i, { metric: event.currentTarget.value })} />
                          {fault(`/goals/${i}`)}
                        </Table.Td>
                        <Table.Td>{own ? <NativeSelect size="xs" aria-label={t("optimise.ofGoal", { number: i + 1 })} value={row.output} data={opened.outputs.map((o) => o.name)} onChange={(event) => goal(i, { output: event.currentTarget.value })} /> : entry?.domain === "loop" ? form.loop : ""}</Table.Td>
                        <Table.Td>
                          <NativeSelect
                            size="xs"
                            aria-label={t("optimise.senseOf", { number: i + 1 })}
                            value={row.sense}
                            data={[
                              { value: "", label: t("optimise.bound") },
                              { value: "minimize", label: t("optimise.minimize") },
                              { value: "maximize", label: t("optimise.maximize") },
                            ]}
                            onChange={(event) => goal(i, { sense: event.currentTarget.value as GoalRow["sense"] })}
                          />
                        </Table.Td>
                        <Table.Td>
                          <NumberEntry aria-label={t("optimise.atLeast", { number: i + 1 })} value={row.lower} unit={unit} optional onCommit={(value) => goal(i, { lower: value })} w={110} />
                        </Table.Td>
                        <Table.Td>
                          <NumberEntry aria-label={t("optimise.atMost", { number: i + 1 })} value={row.upper} unit={unit} optional onCommit={(value) => goal(i, { upper: value })} w={110} />
                        </Table.Td>
                        <Table.Td w={40}>
                          <ActionIcon variant="subtle" color="gray" aria-label={t("optimise.drop", { name: words(row.metric) })} onClick={() => change({ goals: form.goals.filter((_, k) => k !== i) })}>
                            ×
                          </ActionIcon>
                        </Table.Td>
                      </Table.Tr>
                    );
                  })}
                </Table.Tbody>
              </Table>
            </Table.ScrollContainer>
            <Button variant="default" mt="xs" onClick={() => change({ goals: [...form.goals, { metric: "overshoot", output: opened.outputs[0]?.name ?? "", sense: "", upper: 0.05 }] })}>
              {t("optimise.addGoal")}
            </Button>
          </section>
          <section>
            <Title order={2} mb="xs">
              {t("optimise.search")}
            </Title>
            <Group align="flex-start" gap="md">
              <Textarea label={t("optimise.scenarios")} description={t("optimise.scenariosDoc")} placeholder="motor.mass = 2000; motor.leakage = 45 cm**5/(daN*s)" autosize minRows={2} w={420} value={form.scenarios} onChange={(event) => change({ scenarios: event.currentTarget.value })} error={problem?.at("/scenarios")} />
              <Stack gap={6} maw={460}>
                <NativeSelect size="xs" label={t("optimise.method")} value={form.method} data={methods.map((m) => ({ value: m.kind, label: m.title }))} onChange={(event) => change({ method: event.currentTarget.value, options: {} })} />
                <Text fz="xs" c="dimmed">
                  {method?.doc}
                </Text>
                <Group gap="xs">
                  {method?.parameters
                    .filter((p) => (p as { shape?: string }).shape !== "text")
                    .map((p) => (
                      <NumberEntry
                        key={p.name}
                        label={words(p.name)}
                        title={p.doc}
                        value={form.options[p.name]}
                        placeholder={String(p.default ?? "")}
                        optional
                        w={110}
                        onCommit={(value) => {
                          const options = { ...form.options };
                          if (typeof value === "number") options[p.name] = value;
                          else delete options[p.name];
                          change({ options });
                        }}
                      />
                    ))}
                </Group>
              </Stack>
            </Group>
          </section>
          <Group>
            <Button type="submit" size="sm" loading={submit.isPending} disabled={form.variables.length === 0 || form.goals.length === 0}>
              {t("optimise.start")}
            </Button>
            <CopyButton value={pythonOf(body, location.origin)}>{({ copied, copy }) => <Button variant="default" onClick={copy}>{copied ? t("optimise.copied") : t("optimise.python")}</Button>}</CopyButton>
            <CopyButton value={curlOf(body, location.origin)}>{({ copied, copy }) => <Button variant="default" onClick={copy}>{copied ? t("optimise.copied") : t("optimise.curl")}</Button>}</CopyButton>
          </Group>
        </Stack>
      </form>
    </div>
  );
}
