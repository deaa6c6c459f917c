import { zodResolver } from "@hookform/resolvers/zod";
import { Group, MultiSelect, NativeSelect, Stack, Table, Text, TextInput } from "@mantine/core";
import { useMutation, useQueryClient } from "@tanstack/react-query";
import { Controller, useForm } from "react-hook-form";
import { useTranslation } from "react-i18next";
import { useNavigate } from "react-router";
import { z } from "zod";
import { api, must } from "@/shared/api/client";
import type { components } from "@/shared/api/schema";
import { isProblem } from "@/shared/api/problem";
import { scheduleAt } from "@/shared/api/schedules";
import { readFields, writeFields } from "@/shared/forms/address";
import { faultAt } from "@/shared/forms/faults";
import { NumberField } from "@/shared/forms/NumberField";
import { useAddress } from "@/shared/forms/useAddress";
import type { LiveParameter } from "@/shared/live/protocol";
import { firstSliders } from "@/shared/systems/movable";
import { NumberEntry } from "@/shared/ui/NumberEntry";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { withUnit } from "@/shared/units/format";
import { useQueryText } from "@/shared/ui/useQueryText";
import { placesOf, readKnown, readMore, readSought, recordingsOf, writeMore, writeSought } from "./address";
import { FurtherRecordings } from "./FurtherRecordings";
import { MatchFields, type Matched } from "./MatchFields";
import { ExpectedCost, OffsetsSelect, StartButtons } from "./parts";

const scalar = z.union([z.number(), z.object({ value: z.number(), unit: z.string() })]).optional();
const schema = z.object({
  parameters: z.array(z.object({ path: z.string(), lower: scalar, upper: scalar })).min(1, "matching.needParameter"),
  split: z.number("forms.number").min(0, "matching.share").max(1, "matching.share"),
  offsets: z.enum(["none", "estimate"]),
  initial_states: z.enum(["rest", "estimate"]),
  starts: z.number("forms.number").int("forms.whole").min(1, "forms.positive").max(100, "forms.atMost 100"),
  known: z.string().refine((text) => readKnown(text) !== undefined, "optimise.badScenario"),
  max_evaluations: z.number("forms.number").int("forms.whole").min(1, "forms.positive"),
});
type Fields = z.infer<typeof schema>;
type Expected = components["schemas"]["ExpectedReply"];

const BEGIN = { split: 0.5, offsets: "none", initial_states: "rest", starts: 1, known: "", max_evaluations: 60 } as const satisfies Omit<Fields, "parameters">;
const { parameters: _, ...SHAPE } = schema.shape;

const SHOWN = ["/system", "/parameters", "/starts", "/max_evaluations"];

/** Parameters of a system, sought in one recording or several. */
export function GreyBoxForm({ found }: { found: Matched }) {
  const { t } = useTranslation();
  const navigate = useNavigate();
  const queries = useQueryClient();
  const [query, setQuery] = useQueryText();
  const more = readMore(query);
  const all = found.opened?.parameters.filter((one) => !one.bound) ?? [];
  const first = firstSliders(all, 3);
  const held = {
    read: (at: URLSearchParams): Fields => ({ ...readFields<Omit<Fields, "parameters">>(at, BEGIN, SHAPE), parameters: readSought(at, all.map(({ path }) => path), first) }),
    write: ({ parameters, ...rest }: Fields) => ({ ...writeFields<Omit<Fields, "parameters">>(rest, BEGIN), ...writeSought(parameters, first) }),
  };
  const form = useForm<Fields>({ resolver: zodResolver(schema), defaultValues: held.read(query) });
  const { control, register, handleSubmit, watch, setValue, formState } = form;
  useAddress(form, held);
  const bodyOf = (fields: Fields) => ({
    system: found.match.system,
    ...recordingsOf(found.match, fields, more),
    parameters: fields.parameters.map(({ path, lower, upper }) => (lower === undefined && upper === undefined ? path : { parameter: path, ...(lower !== undefined ? { lower } : {}), ...(upper !== undefined ? { upper } : {}) })),
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
  const ask = useMutation({ onMutate: () => start.reset(), mutationFn: (fields: Fields) => must(api.POST("/v1/identifications", { params: { query: { dry_run: true } }, body: bodyOf(fields) as never })) as unknown as Promise<Expected> });
  const failed = start.error ?? ask.error;
  const problem = isProblem(failed) ? failed : null;
  // With several recordings the first one is an experiment, too.
  const wrong = (pointer: string) => problem?.at(pointer) ?? problem?.at(`/experiments/0${pointer}`);
  const own = (field: keyof Fields, factor?: number) => faultAt(t, form, null, field, undefined, factor) ?? wrong(`/${field}`);
  const rows = watch("parameters");
  const byPath = new Map(all.map((one) => [one.path, one]));
  const choose = (paths: string[]) => setValue("parameters", paths.map((path) => rows.find((row) => row.path === path) ?? { path }), { shouldValidate: formState.isSubmitted });
  const shown = [...SHOWN, ...["", ...[null, ...more].map((_, i) => `/experiments/${i}`)].flatMap((before) => [...placesOf(found.opened, before), `${before}/parameters`])];
  const ready = found.opened !== undefined && found.dataset !== undefined;
  return (
    <form onSubmit={(event) => void handleSubmit((fields) => start.mutate(fields))(event)} noValidate>
      <Stack gap="sm">
        <MatchFields {...found} wrong={wrong} />
        {ready && (
          <>
            {more.length > 0 && <TextInput maw={420} label={t("matching.known")} description={t("matching.knownDoc")} placeholder="load = 25 kg; current = 0.5" {...register("known")} error={own("known") ?? problem?.at("/experiments/0/parameters")} />}
            <FurtherRecordings more={more} opened={found.opened!} onChange={(next) => setQuery((before) => writeMore(before, next))} wrong={(pointer) => problem?.at(pointer)} />
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
              <NumberField control={control} name="split" w={190} label={t("matching.split")} description={t("matching.splitDoc")} unit="%" factor={0.01} error={own("split", 0.01)} />
              <OffsetsSelect {...register("offsets")} />
              <NativeSelect size="xs" w={190} label={t("matching.initial")} description={t("matching.initialDoc")} {...register("initial_states")} data={[{ value: "rest", label: t("matching.rest") }, { value: "estimate", label: t("matching.estimate") }]} />
              <NumberField control={control} name="starts" w={110} label={t("matching.starts")} description={t("matching.startsDoc")} error={own("starts")} />
              <NumberField control={control} name="max_evaluations" w={130} label={t("matching.budget")} description={t("matching.budgetDoc")} error={own("max_evaluations")} />
            </Group>
            <ProblemAlert error={failed} shown={shown} />
            {ask.data && <ExpectedCost {...ask.data} />}
            <StartButtons go={t("matching.find")} busy={start.isPending} onAsk={() => void handleSubmit((fields) => ask.mutate(fields))()} asking={ask.isPending} onSchedule={() => void handleSubmit((fields) => navigate(scheduleAt(t("matching.identify"), { kind: "identification", body: bodyOf(fields) })))()} />
          </>
        )}
        {!ready && found.match.system !== "" && found.match.dataset !== "" && !found.error && <Text fz="sm">…</Text>}
      </Stack>
    </form>
  );
}
