import { Alert, Button, Checkbox, Group, List, MultiSelect, NativeSelect, Paper, Stack, Text, TextInput, Title } from "@mantine/core";
import { useMutation, useQuery } from "@tanstack/react-query";
import { useMemo } from "react";
import { Controller, useForm, type UseFormRegister } from "react-hook-form";
import { useTranslation } from "react-i18next";
import { Link, useParams, useSearchParams } from "react-router";
import { api, atOnce } from "@/shared/api/client";
import { datasetQuery } from "@/shared/api/datasets";
import { isProblem } from "@/shared/api/problem";
import type { components } from "@/shared/api/schema";
import { AnalysisChart } from "@/shared/charts/AnalysisChart";
import type { AnalysisLine, AnalysisSpec } from "@/shared/charts/analysis";
import { systemChoices, systemQuery } from "@/shared/api/systems";
import { readFields, writeFields } from "@/shared/forms/address";
import { faultAt } from "@/shared/forms/faults";
import { NumberField } from "@/shared/forms/NumberField";
import { useAddress } from "@/shared/forms/useAddress";
import { Pairs } from "@/shared/plots/Pairs";
import { describedQuery } from "@/shared/systems/described";
import { DataTable } from "@/shared/ui/DataTable";
import { Empty } from "@/shared/ui/Empty";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { formatNumber, prettyUnit, words } from "@/shared/units/format";
import { ESTIMATORS, FORMS, MEASURED, frfRequest, frfResolver, frfSchema, isPeriodic, measuredPoints, readFrf, WINDOWS, writeFrf, type FrfFields, type Points } from "./frf";

type Reply = components["schemas"]["FrfReply"];
type FrfRequest = components["schemas"]["FrfRequest"];

const ask = (body: Record<string, unknown>): Promise<Reply> => atOnce(api.POST("/v1/frfs", { body: body as unknown as FrfRequest }));
const SHOWN = ["/input", "/output", "/estimator", "/segment", "/window", "/confidence", "/form", "/period", "/steps", "/settle", "/system", "/from", "/to"];
const number = (value: number | null | undefined) => (value == null ? "–" : formatNumber(value, 3));
type Values = (number | null)[] | null | undefined;
const plain = (values: Values): Float64Array => Float64Array.from(values ?? [], (value) => value ?? NaN);
const degrees = (values: Values): Float64Array => plain(values).map((value) => (value * 180) / Math.PI);

/** Measured frequency responses with their coherence and the bounds that hold the truth, natural frequencies, and the doubts. */
export function FrfPage() {
  const { t } = useTranslation();
  const { id = "" } = useParams();
  const [query] = useSearchParams();
  const dataset = useQuery(datasetQuery(id));
  if (dataset.isError) return <ProblemAlert error={dataset.error} m="md" onRetry={() => void dataset.refetch()} />;
  if (!dataset.data) return null;
  const channels = dataset.data.channels.map((channel) => String(channel.name));
  const points = measuredPoints(dataset.data.functions);
  const measured = channels.length < 2 && points.inputs.length > 0 ? points : undefined;
  return (
    <div className="page">
      <PageHead title={t("spectra.frfOf", { name: dataset.data.name })} doc={t("spectra.frfDoc")}>
        <Button variant="default" component={Link} to={`/datasets/${id}`}>
          {t("spectra.toRecording")}
        </Button>
      </PageHead>
      {channels.length < 2 && !measured ? <Empty title={t("spectra.one")}>{t("spectra.oneDoc")}</Empty> : <Form id={id} channels={channels} measured={measured} asked={query.has("input")} fields={readFrf(query, channels, measured)} />}
    </div>
  );
}

function Form({ id, channels, measured, asked, fields }: { id: string; channels: string[]; measured: Points | undefined; asked: boolean; fields: FrfFields }) {
  const { t } = useTranslation();
  const [query, setQuery] = useSearchParams();
  // What has been asked for stands in the address by its own names, and what is filled in beside it as `new.`: both outlive a reload.
  const held = { read: (at: URLSearchParams) => readFields(at, readFrf(at, channels, measured), frfSchema.shape, "new."), write: (filled: FrfFields) => writeFields(filled, fields, "new.") };
  const form = useForm<FrfFields>({ resolver: frfResolver, defaultValues: held.read(query) });
  const { control, register, handleSubmit, watch } = form;
  useAddress(form, held);
  const body = frfRequest(id, fields);
  const found = useQuery({ queryKey: ["frf", id, JSON.stringify(body)], enabled: asked, retry: false, staleTime: Infinity, queryFn: () => ask(body) });
  const problem = isProblem(found.error) ? found.error : null;
  const wrong = (field: keyof FrfFields, pointer?: string) => faultAt(t, form, problem, field, pointer);
  const asking = watch();
  const periodic = isPeriodic(asking);
  const amount = (name: "segment" | "period" | "confidence" | "dwell" | "begin" | "settle", unit = "s") => <NumberField control={control} name={name} w={150} label={t(`spectra.${name}`)} description={t(`spectra.${name}Doc`)} unit={unit} optional error={wrong(name)} />;
  return (
    <Stack gap="md">
      <Paper withBorder p="md">
        <form onSubmit={(event) => void handleSubmit((value) => setQuery(writeFrf(value)))(event)} noValidate>
          <Group align="flex-start">
            <NativeSelect size="xs" label={t("spectra.input")} description={t("spectra.inputDoc")} {...register("input")} data={measured?.inputs ?? channels} error={wrong("input")} />
            <Controller control={control} name="outputs" render={({ field }) => <MultiSelect label={t("spectra.outputs")} description={t("spectra.outputsDoc")} data={measured?.outputs ?? channels} value={field.value} onChange={field.onChange} error={wrong("outputs", "/output")} miw={180} maw={320} />} />
            {!measured && <NativeSelect size="xs" label={t("spectra.estimator")} description={t("spectra.estimatorDoc")} {...register("estimator")} data={ESTIMATORS.map((value) => ({ value, label: t(`spectra.estimators.${value}`) }))} error={wrong("estimator")} />}
            {asking.estimator === "multisine" && amount("period")}
            {asking.estimator === "stepped_sine" && (
              <>
                <TextInput w={260} label={t("spectra.frequencies")} description={t("spectra.frequenciesDoc")} placeholder="5 Hz; 10 Hz; 20 Hz" {...register("frequencies")} error={wrong("frequencies", "/steps")} classNames={{ input: "numbers" }} />
                {amount("dwell")}
                {amount("begin")}
              </>
            )}
            {!measured && (periodic ? amount("settle") : amount("segment"))}
            {!measured && !periodic && <NativeSelect size="xs" label={t("spectra.window")} description={t("spectra.windowDoc")} {...register("window")} data={WINDOWS.map((value) => ({ value, label: t(`spectra.windows.${value}`) }))} error={wrong("window")} />}
            {!measured && amount("confidence", "")}
            <NativeSelect size="xs" label={t("spectra.form")} description={t("spectra.formDoc")} {...register("form")} data={FORMS.map((value) => ({ value, label: t(`spectra.forms.${value || "own"}`) }))} error={wrong("form")} />
          </Group>
          <ModelFields system={asking.system} register={register} wrong={wrong} />
          <Checkbox size="xs" mt="sm" label={t("spectra.modes")} {...register("modes")} />
          <Button type="submit" mt="sm" loading={found.isFetching}>
            {t("spectra.estimate")}
          </Button>
        </form>
      </Paper>
      <ProblemAlert error={found.error} shown={SHOWN} />
      {found.data && <FrfResult reply={found.data} body={body} />}
    </Stack>
  );
}

/** A model that is held against the measurement: its system, and the path that was measured. */
function ModelFields({ system, register, wrong }: { system: string; register: UseFormRegister<FrfFields>; wrong(field: keyof FrfFields): string | undefined }) {
  const { t } = useTranslation();
  const systems = useQuery(systemChoices);
  const stored = useQuery({ ...systemQuery(system), enabled: system !== "" });
  const opened = useQuery({ ...describedQuery(system, stored.data?.revision ?? 0), enabled: system !== "" && stored.data !== undefined }).data;
  const choice = (names: string[]) => [{ value: "", label: t("forms.choose") }, ...names];
  return (
    <Group align="flex-start" mt="sm">
      <NativeSelect size="xs" label={t("spectra.model")} description={t("spectra.modelDoc")} {...register("system")} data={[{ value: "", label: t("spectra.noModel") }, ...(systems.data ?? []).map((row) => ({ value: row.id, label: row.name || row.id }))]} error={wrong("system")} />
      {system && opened && <NativeSelect size="xs" label={t("spectra.modelFrom")} description={t("spectra.modelFromDoc")} {...register("from")} data={choice(opened.inputs)} error={wrong("from")} />}
      {system && opened && <NativeSelect size="xs" label={t("spectra.modelTo")} description={t("spectra.modelToDoc")} {...register("to")} data={choice(opened.outputs.map(({ name }) => name))} error={wrong("to")} />}
    </Group>
  );
}

/** Frequency responses with their bounds and doubts, and what keeps them; `kept` is the id under which they are kept already. */
export function FrfResult({ reply, body, kept }: { reply: Reply; body: Record<string, unknown>; kept?: string }) {
  const { t } = useTranslation();
  const keep = useMutation({ mutationFn: () => ask({ ...body, keep: true }) });
  const file = kept ?? keep.data?.id;
  const outputs = Object.entries(reply.outputs);
  const doubts = outputs.flatMap(([output, found]) => found.doubts.map((doubt) => ({ output, detail: doubt.detail })));
  const spec = useMemo(() => {
    const x = plain(reply.frequency);
    const axis = { label: "ω", unit: "rad/s", log: true };
    const units = [...new Set(outputs.map(([, found]) => prettyUnit(found.unit)))];
    const lines = (pick: (found: Reply["outputs"][string]) => Omit<AnalysisLine, "label" | "x">): AnalysisLine[] => outputs.map(([output, found]) => ({ label: words(output), x, ...pick(found) }));
    const band = (lower: Values, upper: Values, read = plain) => (lower && upper ? { band: { lower: read(lower), upper: read(upper) } } : {});
    const models = outputs.flatMap(([output, { simulated }], i) => (simulated ? [{ simulated, label: t("spectra.modelOf", { output: words(output) }), x, color: i + outputs.length }] : []));
    const marks = (reply.modes?.modes ?? []).flatMap((mode) => (mode.frequency === null ? [] : [{ x: mode.frequency, label: "" }]));
    return {
      magnitude: { title: t("spectra.magnitude"), x: axis, y: { label: "|G|", unit: units.length === 1 ? units[0]! : "", log: true }, lines: [...lines((found) => ({ y: plain(found.magnitude), ...band(found.magnitude_lower, found.magnitude_upper) })), ...models.map(({ simulated, ...line }) => ({ ...line, y: plain(simulated.magnitude) }))], marks } as AnalysisSpec,
      phase: { title: t("panel.phase"), x: axis, y: { label: t("panel.phaseShort"), unit: "°" }, lines: [...lines((found) => ({ y: degrees(found.phase), ...band(found.phase_lower, found.phase_upper, degrees) })), ...models.map(({ simulated, ...line }) => ({ ...line, y: degrees(simulated.phase) }))], marks } as AnalysisSpec,
      coherence: { title: t("spectra.coherence"), x: axis, y: { label: "γ²", unit: "", min: 0, max: 1 }, lines: lines((found) => ({ y: plain(found.coherence) })) } as AnalysisSpec,
    };
  }, [reply, t]);
  return (
    <Stack gap="md" data-testid="frf">
      <Group justify="space-between">
        <Text fz="sm">{body.estimator === MEASURED ? t("spectra.fromFile") : t("spectra.averages", { count: reply.averages, confidence: formatNumber(100 * reply.confidence), resolution: reply.resolution == null ? "–" : formatNumber(reply.resolution) })}</Text>
        <Group gap="xs">
          {keep.data?.id && (
            <Button variant="default" component={Link} to={`/results/${keep.data.id}`}>
              {t("results.open")}
            </Button>
          )}
          {file ? (
            <Button variant="default" component="a" href={`/v1/frfs/${file}/uff`} download={`${file}.uff`}>
              {t("spectra.uff")}
            </Button>
          ) : (
            <Button variant="default" onClick={() => keep.mutate()} loading={keep.isPending}>
              {t("spectra.keep")}
            </Button>
          )}
        </Group>
      </Group>
      <ProblemAlert error={keep.error} />
      {outputs.map(([output, { simulated }]) =>
        simulated ? (
          <Text key={output} fz="sm" data-testid="against-model">
            {t("spectra.against", { output: words(output), within: number(simulated.within_percent), median: number(simulated.median_deviation_db), worst: number(simulated.worst_deviation_db), frequency: number(simulated.worst_frequency), error: number(simulated.relative_error_percent) })}
          </Text>
        ) : null,
      )}
      {(doubts.length > 0 || reply.warnings.length > 0) && (
        <Alert color="orange" variant="outline" title={t("spectra.doubts")}>
          <List size="sm">
            {doubts.map(({ output, detail }) => (
              <List.Item key={output + detail}>
                {words(output)}: {detail}
              </List.Item>
            ))}
            {reply.warnings.filter((warning) => !doubts.some((doubt) => doubt.detail === warning.detail)).map((warning) => (
              <List.Item key={warning.pointer + warning.detail}>{warning.detail}</List.Item>
            ))}
          </List>
        </Alert>
      )}
      <Pairs>
        <AnalysisChart spec={spec.magnitude} height={300} summary={t("spectra.magnitude")} />
        <AnalysisChart spec={spec.phase} height={300} summary={t("panel.phase")} />
      </Pairs>
      {outputs.some(([, found]) => found.coherence) && <AnalysisChart spec={spec.coherence} height={200} summary={t("spectra.coherence")} />}
      {reply.modes && <Modes modes={reply.modes.modes} />}
    </Stack>
  );
}

function Modes({ modes }: { modes: NonNullable<Reply["modes"]>["modes"] }) {
  const { t } = useTranslation();
  const range = (lower: number | null, upper: number | null) => (lower === null || upper === null ? "–" : `${formatNumber(lower)} … ${formatNumber(upper)}`);
  return (
    <section>
      <Title order={2} mb="xs">
        {t("spectra.modesFound")}
      </Title>
      {modes.length === 0 ? (
        <Text fz="sm">{t("spectra.noModes")}</Text>
      ) : (
        <DataTable
          testId="modes"
          minWidth={640}
          maxWidth={960}
          rows={modes}
          keyOf={(_, i) => String(i)}
          columns={[
            { title: `${t("spectra.natural")} [rad/s]`, numeric: true, strong: true, cell: (mode) => (mode.frequency === null ? "–" : formatNumber(mode.frequency, 5)) },
            { title: "[Hz]", numeric: true, cell: (mode) => (mode.frequency === null ? "–" : formatNumber(mode.frequency / (2 * Math.PI), 5)) },
            { title: `${t("found.interval")} [rad/s]`, numeric: true, cell: (mode) => range(mode.frequency_lower, mode.frequency_upper) },
            { title: t("spectra.damping"), numeric: true, strong: true, cell: (mode) => (mode.damping_ratio === null ? "–" : formatNumber(mode.damping_ratio)) },
            { title: t("found.interval"), numeric: true, cell: (mode) => range(mode.damping_ratio_lower, mode.damping_ratio_upper) },
            { title: t("spectra.doubts"), cell: (mode) => mode.doubt },
          ]}
        />
      )}
    </section>
  );
}
