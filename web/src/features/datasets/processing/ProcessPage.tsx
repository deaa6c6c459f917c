import { Button, Group, MultiSelect, NativeSelect, Paper, Stack, Text, TextInput, Title } from "@mantine/core";
import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { Link, useNavigate, useParams } from "react-router";
import { api, must } from "@/shared/api/client";
import { datasetQuery, readyDatasets, type Dataset } from "@/shared/api/datasets";
import { isProblem } from "@/shared/api/problem";
import { contractQuery } from "@/shared/forms/contract";
import { SchemaFields } from "@/shared/forms/SchemaFields";
import type { Field } from "@/shared/forms/schema";
import { Empty } from "@/shared/ui/Empty";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { words } from "@/shared/units/format";
import { useQueryText } from "@/shared/ui/useQueryText";
import { channelsBefore, gaps, readPlan, requestOf, stepKinds, writePlan, type Plan, type Step } from "./steps";

/** A new recording out of this one: filtered, cut, resampled, put together with others; the steps stand in the address. */
export function ProcessPage() {
  const { t } = useTranslation();
  const { id = "" } = useParams();
  const dataset = useQuery(datasetQuery(id));
  const contract = useQuery(contractQuery);
  if (dataset.isError || contract.isError) return <ProblemAlert error={dataset.error ?? contract.error} m="md" onRetry={() => void Promise.all([dataset.refetch(), contract.refetch()])} />;
  if (!dataset.data || !contract.data) return null;
  return (
    <div className="page">
      <PageHead title={t("process.of", { name: dataset.data.name })} doc={t("process.doc")}>
        <Button variant="default" component={Link} to={`/datasets/${id}`}>
          {t("spectra.toRecording")}
        </Button>
      </PageHead>
      <Form dataset={dataset.data} kinds={stepKinds(contract.data)} />
    </div>
  );
}

function Form({ dataset, kinds }: { dataset: Dataset; kinds: Map<string, Field[]> }) {
  const { t } = useTranslation();
  const navigate = useNavigate();
  const queries = useQueryClient();
  const [query, setQuery] = useQueryText();
  const plan = readPlan(query);
  const [empty, setEmpty] = useState<string[]>([]);
  const change = (part: Partial<Plan>) => setQuery((before) => writePlan({ ...readPlan(before), ...part }));
  const others = useQuery(readyDatasets);
  const channels = [...new Set(dataset.channels.map((channel) => String(channel.name)))];
  const make = useMutation({
    mutationFn: () => must(api.POST("/v1/processings", { body: requestOf(plan, dataset.id, kinds) as never })),
    onSuccess: (made) => {
      void queries.invalidateQueries({ queryKey: ["datasets"] });
      // Much of it is done by a worker, whose job is shown meanwhile.
      void navigate(made.id.startsWith("job_") ? `/jobs/${made.id}` : `/datasets/${made.id}`);
    },
  });
  const problem = isProblem(make.error) ? make.error : null;
  const submit = () => {
    const found = [...(plan.name.trim() ? [] : ["name"]), ...gaps(plan, kinds)];
    setEmpty(found);
    if (found.length === 0) make.mutate();
  };
  const put = (index: number, step: Step | null, to = index) => {
    const steps = plan.steps.filter((_, i) => i !== index);
    if (step) steps.splice(to, 0, step);
    setEmpty([]);
    make.reset();
    change({ steps });
  };
  const wrong = (place: string, pointer: string) => (empty.includes(place) ? t("forms.required") : problem?.at(pointer));
  const shown = ["/name", "/sources", "/combine", ...plan.steps.flatMap((step, i) => (kinds.get(step.kind) ?? []).map(({ name }) => `/steps/${i}/${name}`))];
  return (
    <form
      noValidate
      onSubmit={(event) => {
        event.preventDefault();
        submit();
      }}
    >
      <Stack gap="md">
        <Group align="flex-start">
          <TextInput label={t("process.name")} value={plan.name} onChange={(event) => change({ name: event.currentTarget.value })} error={wrong("name", "/name")} w={300} />
          <MultiSelect label={t("process.others")} description={t("process.othersDoc")} data={(others.data ?? []).filter((row) => row.id !== dataset.id).map((row) => ({ value: row.id, label: row.name }))} value={plan.others} onChange={(next) => change({ others: next })} searchable error={problem?.at("/sources")} w={360} />
          {plan.others.length > 0 && <NativeSelect size="xs" label={t("process.combine")} value={plan.combine} onChange={(event) => change({ combine: event.currentTarget.value as Plan["combine"] })} data={(["append", "side_by_side"] as const).map((value) => ({ value, label: t(`process.combines.${value}`) }))} error={problem?.at("/combine")} />}
        </Group>
        {plan.steps.length === 0 && <Empty title={t("process.none")}>{t("process.noneDoc")}</Empty>}
        {plan.steps.map((step, i) => (
          <Paper key={`${i}.${step.kind}`} withBorder p="sm" component="section" aria-labelledby={`step-${i}`} data-testid="step">
            <Group justify="space-between" mb="xs">
              <Title order={2} id={`step-${i}`}>
                {i + 1}. {t(`process.kinds.${step.kind}`, words(step.kind))}
              </Title>
              <Group gap={4}>
                <Button size="compact-xs" variant="subtle" disabled={i === 0} onClick={() => put(i, step, i - 1)} aria-label={t("process.earlier", { number: i + 1 })}>
                  ↑
                </Button>
                <Button size="compact-xs" variant="subtle" disabled={i === plan.steps.length - 1} onClick={() => put(i, step, i + 1)} aria-label={t("process.later", { number: i + 1 })}>
                  ↓
                </Button>
                <Button size="compact-xs" variant="subtle" color="red" onClick={() => put(i, null)} aria-label={t("process.drop", { number: i + 1 })}>
                  ×
                </Button>
              </Group>
            </Group>
            <SchemaFields fields={kinds.get(step.kind) ?? []} values={step} channels={channelsBefore(channels, plan.steps, i)} onChange={(values) => put(i, { ...values, kind: step.kind })} wrong={(field) => wrong(`${i}.${field}`, `/steps/${i}/${field}`)} />
          </Paper>
        ))}
        <Group gap="xs" align="center" role="group" aria-label={t("process.add")}>
          <Text fz="sm">{t("process.add")}</Text>
          {[...kinds.keys()].map((kind) => (
            <Button key={kind} size="compact-sm" variant="default" onClick={() => change({ steps: [...plan.steps, { kind }] })}>
              {t(`process.kinds.${kind}`, words(kind))}
            </Button>
          ))}
        </Group>
        <ProblemAlert error={make.error} shown={shown} />
        <Group>
          <Button type="submit" loading={make.isPending} disabled={plan.steps.length === 0 && plan.others.length === 0}>
            {t("process.make")}
          </Button>
        </Group>
      </Stack>
    </form>
  );
}
