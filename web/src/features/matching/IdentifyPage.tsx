import { zodResolver } from "@hookform/resolvers/zod";
import { Button, Group, MultiSelect, NativeSelect, NumberInput, Paper, Stack, Table, Text } from "@mantine/core";
import { useMutation, useQueryClient } from "@tanstack/react-query";
import { Controller, useForm } from "react-hook-form";
import { useTranslation } from "react-i18next";
import { useNavigate, useSearchParams } from "react-router";
import { z } from "zod";
import { api, must } from "@/shared/api/client";
import { isProblem } from "@/shared/api/problem";
import { scheduleAt } from "@/shared/api/schedules";
import type { LiveParameter } from "@/shared/live/protocol";
import { firstSliders } from "@/shared/systems/movable";
import { NumberEntry } from "@/shared/ui/NumberEntry";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { withUnit } from "@/shared/units/format";
import { given } from "./address";
import { MatchFields, useMatch } from "./MatchFields";

const scalar = z.union([z.number(), z.object({ value: z.number(), unit: z.string() })]).optional();
const schema = z.object({
  parameters: z.array(z.object({ path: z.string(), lower: scalar, upper: scalar })).min(1, "matching.needParameter"),
  split: z.number("forms.number").min(0, "matching.share").max(1, "matching.share"),
  offsets: z.enum(["none", "estimate"]),
  initial_states: z.enum(["rest", "estimate"]),
  starts: z.number("forms.number").int("forms.whole").min(1, "forms.positive").max(100),
  max_evaluations: z.number("forms.number").int("forms.whole").min(1, "forms.positive"),
});
type Fields = z.infer<typeof schema>;

const SHOWN = ["/system", "/dataset", "/inputs", "/outputs", "/parameters", "/split", "/starts", "/max_evaluations"];

/** Which parameters are sought in which recording; a worker seeks them, and the page of its job shows how it goes and what it found. */
export function IdentifyPage() {
  const { t } = useTranslation();
  const found = useMatch();
  return (
    <div className="page">
      <PageHead title={t("matching.identify")} doc={t("matching.identifyDoc")} />
      <Paper withBorder p="md" maw={860}>
        <Form key={found.opened?.system?.id ?? "none"} found={found} />
      </Paper>
    </div>
  );
}

function Form({ found }: { found: ReturnType<typeof useMatch> }) {
  const { t } = useTranslation();
  const navigate = useNavigate();
  const queries = useQueryClient();
  const [query, setQuery] = useSearchParams();
  const all = found.opened?.parameters.filter((one) => !one.bound) ?? [];
  const named = (query.get("p") ?? "").split(",").filter((path) => all.some((one) => one.path === path));
  const { control, register, handleSubmit, watch, setValue, formState } = useForm<Fields>({
    resolver: zodResolver(schema),
    defaultValues: { parameters: (named.length > 0 ? named : firstSliders(all, 3)).map((path) => ({ path })), split: Number(query.get("split") ?? 0.5), offsets: "none", initial_states: "rest", starts: 1, max_evaluations: 60 },
  });
  const bodyOf = (fields: Fields) => ({
    system: found.match.system,
    dataset: found.match.dataset,
    inputs: given(found.match.inputs),
    outputs: given(found.match.outputs),
    parameters: fields.parameters.map(({ path, lower, upper }) => (lower === undefined && upper === undefined ? path : { parameter: path, ...(lower !== undefined ? { lower } : {}), ...(upper !== undefined ? { upper } : {}) })),
    split: fields.split,
    offsets: fields.offsets,
    initial_states: fields.initial_states,
    starts: fields.starts,
    max_evaluations: fields.max_evaluations,
  });
  const start = useMutation({
    mutationFn: (fields: Fields) => must(api.POST("/v1/identifications", { body: bodyOf(fields) as never })),
    onSuccess: (job) => {
      void queries.invalidateQueries({ queryKey: ["jobs"] });
      void navigate(`/jobs/${job.id}`);
    },
  });
  const problem = isProblem(start.error) ? start.error : null;
  const wrong = (pointer: string) => problem?.at(pointer);
  const own = (field: keyof Fields) => {
    const message = formState.errors[field]?.message;
    return message ? t(message) : wrong(`/${field}`);
  };
  const rows = watch("parameters");
  const byPath = new Map(all.map((one) => [one.path, one]));
  const choose = (paths: string[]) => {
    setValue("parameters", paths.map((path) => rows.find((row) => row.path === path) ?? { path }), { shouldValidate: formState.isSubmitted });
    setQuery((before) => new URLSearchParams([...[...before].filter(([key]) => key !== "p"), ["p", paths.join(",")]]), { replace: true });
  };
  const ready = found.opened !== undefined && found.dataset !== undefined;
  return (
    <form onSubmit={(event) => void handleSubmit((fields) => start.mutate(fields))(event)} noValidate>
      <Stack gap="sm">
        <MatchFields {...found} wrong={wrong} />
        {ready && (
          <>
            <MultiSelect label={t("matching.parameters")} description={t("matching.parametersDoc")} data={all.map((one) => one.path)} value={rows.map((row) => row.path)} onChange={choose} searchable error={own("parameters")} />
            {rows.length > 0 && (
              <Table maw={640} data-testid="sought">
                <Table.Thead>
                  <Table.Tr>
                    <Table.Th>{t("panel.parameters")}</Table.Th>
                    <Table.Th>{t("jobs.start")}</Table.Th>
                    <Table.Th>{t("matching.lower")}</Table.Th>
                    <Table.Th>{t("matching.upper")}</Table.Th>
                  </Table.Tr>
                </Table.Thead>
                <Table.Tbody>
                  {rows.map((row, i) => {
                    const known: LiveParameter | undefined = byPath.get(row.path);
                    return (
                      <Table.Tr key={row.path}>
                        <Table.Td>{row.path}</Table.Td>
                        <Table.Td className="numbers">{known ? withUnit(known.value, known.unit) : ""}</Table.Td>
                        {(["lower", "upper"] as const).map((bound) => (
                          <Table.Td key={bound}>
                            <Controller control={control} name={`parameters.${i}.${bound}`} render={({ field }) => <NumberEntry aria-label={t(`matching.${bound}Of`, { name: row.path })} unit={known?.unit ?? ""} value={field.value} optional onCommit={(value) => field.onChange(typeof value === "string" ? undefined : value)} error={wrong(`/parameters/${i}/${bound}`)} w={140} />} />
                          </Table.Td>
                        ))}
                      </Table.Tr>
                    );
                  })}
                </Table.Tbody>
              </Table>
            )}
            <Group align="flex-start">
              <Controller control={control} name="split" render={({ field }) => <NumberInput size="xs" w={190} label={t("matching.split")} description={t("matching.splitDoc")} min={0} max={100} suffix=" %" hideControls value={Number.isNaN(field.value) ? "" : Math.round(field.value * 1000) / 10} onChange={(value) => field.onChange(value === "" ? NaN : Number(value) / 100)} error={own("split")} />} />
              <NativeSelect size="xs" w={190} label={t("matching.offsets")} description={t("matching.offsetsDoc")} {...register("offsets")} data={[{ value: "none", label: t("matching.no") }, { value: "estimate", label: t("matching.estimate") }]} />
              <NativeSelect size="xs" w={190} label={t("matching.initial")} description={t("matching.initialDoc")} {...register("initial_states")} data={[{ value: "rest", label: t("matching.rest") }, { value: "estimate", label: t("matching.estimate") }]} />
              <Controller control={control} name="starts" render={({ field }) => <NumberInput size="xs" w={110} label={t("matching.starts")} description={t("matching.startsDoc")} hideControls value={Number.isNaN(field.value) ? "" : field.value} onChange={(value) => field.onChange(value === "" ? NaN : Number(value))} error={own("starts")} />} />
              <Controller control={control} name="max_evaluations" render={({ field }) => <NumberInput size="xs" w={130} label={t("matching.budget")} description={t("matching.budgetDoc")} hideControls value={Number.isNaN(field.value) ? "" : field.value} onChange={(value) => field.onChange(value === "" ? NaN : Number(value))} error={own("max_evaluations")} />} />
            </Group>
            <ProblemAlert error={start.error} shown={SHOWN} />
            <Group>
              <Button type="submit" loading={start.isPending}>
                {t("matching.find")}
              </Button>
              <Button variant="default" onClick={() => void handleSubmit((fields) => navigate(scheduleAt(t("matching.identify"), { kind: "identification", body: bodyOf(fields) })))()}>
                {t("schedules.new")}
              </Button>
            </Group>
          </>
        )}
        {!ready && found.match.system !== "" && found.match.dataset !== "" && !found.error && <Text fz="sm">…</Text>}
      </Stack>
    </form>
  );
}
