import { zodResolver } from "@hookform/resolvers/zod";
import { ActionIcon, Button, CopyButton, Group, NativeSelect, Stack, Table, Text, Textarea, Title } from "@mantine/core";
import { useMutation, useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { get, useForm, type FieldPath } from "react-hook-form";
import { useTranslation } from "react-i18next";
import { useNavigate, useParams, useSearchParams } from "react-router";
import { methodsQuery, metricsQuery } from "@/shared/api/catalogue";
import { api, must } from "@/shared/api/client";
import { Problem } from "@/shared/api/problem";
import type { components } from "@/shared/api/schema";
import { systemQuery } from "@/shared/api/systems";
import type { MethodEntry, MetricEntry } from "@/shared/api/types";
import type { Opened } from "@/shared/live/protocol";
import { describedQuery } from "@/shared/systems/described";
import { loopsOf } from "@/shared/systems/loops";
import { firstSliders } from "@/shared/systems/movable";
import { NumberEntry } from "@/shared/ui/NumberEntry";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { prettyUnit, words } from "@/shared/units/format";
import type { GoalRow, ProblemForm, VariableRow } from "@/shared/systems/search";
import { bodyOf, curlOf, goalMetrics, pythonOf } from "./problem";
import { fieldOf, search, shape } from "./schema";

/** What may be chosen, what is wanted, and how it is searched for; the form is made from the catalogue. */
export function OptimisePage() {
  const { id = "" } = useParams();
  const system = useQuery(systemQuery(id)).data!;
  const described = useQuery(describedQuery(id, system.revision));
  const metrics = useQuery(metricsQuery).data;
  const methods = useQuery(methodsQuery).data;
  const [query] = useSearchParams();
  if (described.isError) return <ProblemAlert error={described.error} m="md" onRetry={() => void described.refetch()} />;
  if (!described.data || !metrics || !methods) return null;
  const loops = loopsOf(system.document);
  return <Form key={system.revision} id={id} opened={described.data} loops={loops} metrics={metrics} methods={methods} given={keptIn(query.get("f")) ?? firstOf(described.data, loops)} />;
}

/** The form that the address holds, if it does. */
function keptIn(text: string | null): ProblemForm | null {
  if (!text) return null;
  try {
    return shape.safeParse(JSON.parse(text)).data ?? null;
  } catch {
    return null;
  }
}

/** A first visit is given a form that makes sense for most loops. */
function firstOf(opened: Opened, loops: string[]): ProblemForm {
  const output = opened.outputs[0]?.name ?? "";
  const known = new Map(opened.parameters.map((p) => [p.path, p]));
  return {
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
  };
}

interface Props {
  id: string;
  opened: Opened;
  loops: string[];
  metrics: Map<string, MetricEntry>;
  methods: MethodEntry[];
  given: ProblemForm;
}

function Form({ id, opened, loops, metrics, methods, given }: Props) {
  const { t } = useTranslation();
  const navigate = useNavigate();
  const [, setQuery] = useSearchParams();
  const { watch, setValue, setError, clearErrors, handleSubmit, formState } = useForm<ProblemForm>({ resolver: zodResolver(search), defaultValues: given });
  const [placed, setPlaced] = useState<string[]>([]);
  const form = watch();
  const domains = { get: (name: string) => metrics.get(name)?.domain };
  // The address holds the form.
  const change = (part: Partial<ProblemForm>) => {
    for (const [key, value] of Object.entries(part)) {
      clearErrors(key as keyof ProblemForm);
      setValue(key as keyof ProblemForm, value as never);
    }
    setQuery({ f: JSON.stringify({ ...form, ...part }) }, { replace: true });
  };
  const submit = useMutation({
    mutationFn: (asked: ProblemForm) => must(api.POST("/v1/optimizations", { body: bodyOf(asked, id, domains) as components["schemas"]["OptimizationRequest"] })),
    onSuccess: (job) => void navigate(`/jobs/${job.id}`),
    // What the service finds wrong is told at the field it belongs to; the rest above the form.
    onError: (error) => {
      const faults = (error instanceof Problem && error.document.errors) || [];
      const own = faults.flatMap((fault) => {
        const field = fieldOf(fault.pointer);
        return field === null ? [] : [{ ...fault, field }];
      });
      for (const { field, detail } of own) setError(field as FieldPath<ProblemForm>, { type: "service", message: detail });
      setPlaced(own.map((fault) => fault.pointer));
    },
  });
  const faultAt = (field: string): string | undefined => {
    const message = (get(formState.errors, field) as { message?: string } | undefined)?.message;
    return message === undefined ? undefined : t(message, message);
  };
  /** The sentences that belong to one row, said beneath it. */
  const faults = (row: string, fields: string[]) => {
    const said = fields.flatMap((field) => faultAt(`${row}.${field}`) ?? []);
    return said.length === 0 ? null : (
      <Text fz="xs" c="var(--mantine-color-error)" role="alert">
        {said.join("; ")}
      </Text>
    );
  };
  const free = opened.parameters.filter((p) => !p.bound);
  const units = new Map(opened.parameters.map((p) => [p.path, p.unit]));
  const method = methods.find((m) => m.kind === form.method);
  const body = bodyOf(form, id, domains);
  const variable = (i: number, part: Partial<VariableRow>) => change({ variables: form.variables.map((row, k) => (k === i ? { ...row, ...part } : row)) });
  /** One that is not said is left to the method. */
  const option = (name: string, value: number | string | undefined) => change({ options: Object.fromEntries(Object.entries({ ...form.options, [name]: value }).flatMap(([key, own]) => (own === undefined ? [] : [[key, own]]))) });
  const goal = (i: number, part: Partial<GoalRow>) => change({ goals: form.goals.map((row, k) => (k === i ? { ...row, ...part } : row)) });

  return (
    <div className="page">
      <form
        noValidate
        onSubmit={(event) => {
          clearErrors();
          void handleSubmit((asked) => submit.mutate(asked))(event);
        }}
      >
        <Stack gap="lg">
          <ProblemAlert error={submit.error} shown={placed} />
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
                      {faults(`variables.${i}`, ["parameter", "lower", "upper"])}
                    </Table.Td>
                    <Table.Td>
                      <NumberEntry aria-label={t("optimise.from", { name: row.parameter })} value={row.lower} unit={units.get(row.parameter)} error={faultAt(`variables.${i}.lower`) !== undefined} optional placeholder={t("optimise.asDocument")} onCommit={(value) => variable(i, { lower: value })} />
                    </Table.Td>
                    <Table.Td>
                      <NumberEntry aria-label={t("optimise.to", { name: row.parameter })} value={row.upper} unit={units.get(row.parameter)} error={faultAt(`variables.${i}.upper`) !== undefined} optional placeholder={t("optimise.asDocument")} onCommit={(value) => variable(i, { upper: value })} />
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
                          <NativeSelect size="xs" aria-label={t("optimise.goal", { number: i + 1 })} title={entry?.definition} value={row.metric} data={goalMetrics(metrics.values(), loops, row.metric).map((m) => ({ value: m.kind, label: t(`metrics.${m.kind}`, words(m.kind)) }))} onChange={(event) => goal(i, { metric: event.currentTarget.value })} />
                          {faults(`goals.${i}`, ["metric", "output", "sense", "lower", "upper"])}
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
                          <NumberEntry aria-label={t("optimise.atLeast", { number: i + 1 })} value={row.lower} unit={unit} error={faultAt(`goals.${i}.lower`) !== undefined} optional onCommit={(value) => goal(i, { lower: value })} w={110} />
                        </Table.Td>
                        <Table.Td>
                          <NumberEntry aria-label={t("optimise.atMost", { number: i + 1 })} value={row.upper} unit={unit} error={faultAt(`goals.${i}.upper`) !== undefined} optional onCommit={(value) => goal(i, { upper: value })} w={110} />
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
              <Textarea label={t("optimise.scenarios")} description={t("optimise.scenariosDoc")} placeholder="motor.mass = 2000; motor.leakage = 45 cm**5/(daN*s)" autosize minRows={2} w={420} value={form.scenarios} onChange={(event) => change({ scenarios: event.currentTarget.value })} error={faultAt("scenarios")} />
              <Stack gap={6} maw={460}>
                <NativeSelect size="xs" label={t("optimise.method")} value={form.method} data={methods.map((m) => ({ value: m.kind, label: m.title }))} error={faultAt("method")} onChange={(event) => change({ method: event.currentTarget.value, options: {} })} />
                <Text fz="xs" c="dimmed">
                  {method?.doc}
                </Text>
                <Group gap="xs">
                  {method?.parameters.map((p) => {
                    const { choices } = p as { choices?: string[] };
                    const common = { label: words(p.name), title: p.doc, error: faultAt(`options.${p.name}`) };
                    return choices ? (
                      <NativeSelect key={p.name} size="xs" {...common} value={String(form.options[p.name] ?? p.default)} data={choices.map((value) => ({ value, label: words(value) }))} onChange={(event) => option(p.name, event.currentTarget.value === p.default ? undefined : event.currentTarget.value)} />
                    ) : (
                      <NumberEntry key={p.name} {...common} value={form.options[p.name]} placeholder={String(p.default ?? "")} optional w={110} onCommit={(value) => option(p.name, typeof value === "number" ? value : undefined)} />
                    );
                  })}
                </Group>
              </Stack>
            </Group>
          </section>
          <Group>
            <Button type="submit" size="sm" data-tour-of="optimise" loading={submit.isPending} disabled={form.variables.length === 0 || form.goals.length === 0}>
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
