import { zodResolver } from "@hookform/resolvers/zod";
import { Alert, Button, Checkbox, Group, List, NativeSelect, NumberInput, Paper, Progress, Stack, Table, Text, TextInput } from "@mantine/core";
import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useEffect } from "react";
import { Controller, FormProvider, useForm } from "react-hook-form";
import { useTranslation } from "react-i18next";
import { Link, useNavigate, useParams, useSearchParams } from "react-router";
import { api, must } from "@/shared/api/client";
import { jobQuery, resultQuery } from "@/shared/api/jobs";
import { isProblem, Problem } from "@/shared/api/problem";
import { faultAt } from "@/shared/forms/faults";
import { useAddress } from "@/shared/forms/useAddress";
import { Empty } from "@/shared/ui/Empty";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { formatNumber, prettyUnit } from "@/shared/units/format";
import { FunctionTable, type FunctionHead } from "./Functions";
import { GroupBoxes, UnevenFields } from "./ImportParts";
import { fieldsOf, firstOf, importOf, importSchema, isTable, layoutOf, readDraft, writeDraft, type ImportDocument, type ImportFields, type Look } from "./importing";
import { datasetQuery } from "@/shared/api/datasets";
import { forgetManifest, manifestOf, type Manifest } from "./upload";

/** How a file that has arrived is read: what a worker found in it, and what of it becomes a channel of which name and unit. */
export function ImportPage() {
  const { t } = useTranslation();
  const { id = "" } = useParams();
  const [query, setQuery] = useSearchParams();
  const dataset = useQuery({ ...datasetQuery(id), refetchInterval: false });
  const manifest = manifestOf(id);
  const job = query.get("look") ?? "";
  const look = useMutation({
    mutationFn: (given: ImportDocument | null) => must(api.POST("/v1/datasets/{identifier}/preview", { params: { path: { identifier: id } }, body: { segments: manifest!.segments, ...(given ? { import: given } : {}) } })),
    onSuccess: (found) => setQuery({ look: found.job.id }, { replace: true, preventScrollReset: true }),
  });
  const running = useQuery({ ...jobQuery(job), enabled: job !== "", refetchInterval: (q) => (q.state.data && ["succeeded", "failed", "cancelled"].includes(q.state.data.status) ? false : 400) });
  const done = running.data?.status === "succeeded";
  const result = useQuery({ ...resultQuery(job), enabled: job !== "" && done });
  const first = manifest !== null && job === "" && dataset.data?.status === "open" && look.isIdle;
  useEffect(() => {
    if (first) look.mutate(null);
  });
  if (dataset.isError) return <ProblemAlert error={dataset.error} m="md" onRetry={() => void dataset.refetch()} />;
  if (!dataset.data) return null;
  const back = (
    <Button component={Link} to={`/datasets/${id}`}>
      {t("spectra.toRecording")}
    </Button>
  );
  return (
    <div className="page">
      <PageHead title={t("datasets.importOf", { name: dataset.data.name })} doc={t("importing.doc")} />
      {manifest === null ? (
        <Empty title={t("importing.elsewhere")} action={back}>
          {t("importing.elsewhereDoc")}
        </Empty>
      ) : (
        <Stack gap="md">
          <ProblemAlert error={look.error ?? running.error ?? result.error} onRetry={() => look.mutate(null)} />
          {running.data?.error && <ProblemAlert error={new Problem({ title: "", status: 0, detail: "", ...(running.data.error as object) })} />}
          {(running.data?.error || look.error) && (
            <Group>
              <Button component={Link} to="/datasets">
                {t("importing.otherFormat")}
              </Button>
            </Group>
          )}
          {(look.isPending || (job !== "" && !result.data && running.data?.status !== "failed" && !running.error)) && (
            <div>
              <Text fz="sm">{t("importing.looking")}</Text>
              <Progress value={100} animated aria-label={t("importing.looking")} />
            </div>
          )}
          {result.data && <Found key={job} id={id} manifest={manifest} look={result.data as unknown as Look} onLook={(given) => look.mutate(given)} />}
        </Stack>
      )}
    </div>
  );
}

/** A file of functions of frequency alone has nothing to be mapped: it is taken whole. */
function Found(props: { id: string; manifest: Manifest; look: Look; onLook(given: ImportDocument | null): void }) {
  const { look } = props;
  return look.functions && look.functions.length > 0 && look.import === null && look.series.length === 0 ? <Whole {...props} functions={look.functions} /> : <Mapping {...props} />;
}

function Whole({ id, manifest, look, functions }: { id: string; manifest: Manifest; look: Look; functions: FunctionHead[] }) {
  const { t } = useTranslation();
  const navigate = useNavigate();
  const queries = useQueryClient();
  const commit = useMutation({
    mutationFn: () => must(api.POST("/v1/datasets/{identifier}/commit", { params: { path: { identifier: id } }, body: manifest })),
    onSuccess: () => {
      forgetManifest(id);
      void queries.invalidateQueries({ queryKey: ["dataset", id] });
      void queries.invalidateQueries({ queryKey: ["datasets"] });
      void navigate(`/datasets/${id}`);
    },
  });
  return (
    <Stack gap="md" data-testid="import-functions">
      <Remarks look={look} />
      <FunctionTable functions={functions} />
      <ProblemAlert error={commit.error} />
      <Group>
        <Button onClick={() => commit.mutate()} loading={commit.isPending}>
          {t("datasets.send")}
        </Button>
      </Group>
    </Stack>
  );
}

/** What was noticed in a file, and what of it is refused. */
function Remarks({ look }: { look: Look }) {
  const { t } = useTranslation();
  return (
    <>
      {look.remarks.length > 0 && (
        <Alert color="blue" variant="outline" title={t("importing.noticed")}>
          <List size="sm">
            {look.remarks.map((remark) => (
              <List.Item key={remark}>{remark}</List.Item>
            ))}
          </List>
        </Alert>
      )}
      {Object.keys(look.refused).length > 0 && (
        <Alert color="orange" variant="outline" title={t("importing.refused")}>
          <List size="sm">
            {Object.entries(look.refused).map(([name, reason]) => (
              <List.Item key={name}>
                {name}: {reason}
              </List.Item>
            ))}
          </List>
        </Alert>
      )}
    </>
  );
}

function Mapping({ id, manifest, look, onLook }: { id: string; manifest: Manifest; look: Look; onLook(given: ImportDocument | null): void }) {
  const { t } = useTranslation();
  const navigate = useNavigate();
  const queries = useQueryClient();
  const table = isTable(look.import);
  const [query] = useSearchParams();
  const begin = fieldsOf(look);
  const held = { read: (at: URLSearchParams) => readDraft(at, begin), write: (fields: ImportFields) => writeDraft(fields, begin) };
  const form = useForm<ImportFields>({ resolver: zodResolver(importSchema), defaultValues: held.read(query) });
  const { control, register, handleSubmit, watch, getValues, formState } = form;
  useAddress(form, held);
  const commit = useMutation({
    mutationFn: (fields: ImportFields) => must(api.POST("/v1/datasets/{identifier}/commit", { params: { path: { identifier: id } }, body: { ...manifest, import: importOf(fields, table) } })),
    onSuccess: () => {
      forgetManifest(id);
      void queries.invalidateQueries({ queryKey: ["dataset", id] });
      void queries.invalidateQueries({ queryKey: ["datasets"] });
      void navigate(`/datasets/${id}`);
    },
  });
  const problem = isProblem(commit.error) ? commit.error : null;
  const columns = watch("columns");
  /** The place of a row in the request, which holds only those that are taken. */
  const place = (i: number) => columns.slice(0, i).filter((column) => column.take).length;
  const wrongCell = (i: number, key: "name" | "unit" | "scale" | "offset" | "quantity") => faultAt(t, form, columns[i]!.take ? problem : null, `columns.${i}.${key}`, `/import/columns/${place(i)}/${key}`);
  const wrong = (key: Exclude<keyof ImportFields, "columns">, pointer: string) => faultAt(t, form, problem, key, pointer);
  const shown = ["/import/delimiter", "/import/decimal", "/import/thousands", "/import/comment", "/import/header_lines", "/import/missing", "/import/time", "/import/sample_rate", "/import/gaps", "/import/uneven", "/import/time_zone", ...columns.flatMap((column, i) => (column.take ? ["name", "unit", "scale", "offset", "quantity"].map((key) => `/import/columns/${place(i)}/${key}`) : []))];
  const number = (name: `columns.${number}.scale` | `columns.${number}.offset`, label: string, error: string | undefined) => <Controller control={control} name={name} render={({ field }) => <NumberInput size="xs" w={100} aria-label={label} hideControls value={Number.isNaN(field.value) ? "" : field.value} onChange={(value) => field.onChange(value === "" ? NaN : Number(value))} error={error} classNames={{ input: "numbers" }} />} />;
  const sample = (index: number) => firstOf(look, index).slice(0, 3).map((value) => (value === null ? "–" : formatNumber(value))).join("   ");
  return (
    <FormProvider {...form}>
    <form onSubmit={(event) => void handleSubmit((fields) => commit.mutate(fields))(event)} noValidate data-testid="import">
      <Stack gap="md">
        {look.sample_count !== null && (
          <Text fz="sm" c="dimmed">
            {look.sample_rate === null ? t("importing.holdsUneven", { count: look.sample_count }) : t("importing.holds", { count: look.sample_count, rate: formatNumber(look.sample_rate) })}
          </Text>
        )}
        <Remarks look={look} />
        <Paper withBorder p="md">
          <Group align="flex-start">
            {table && (
              <>
                <NativeSelect
                  size="xs"
                  label={t("datasets.delimiter")}
                  {...register("delimiter")}
                  data={[
                    { value: "\t", label: t("datasets.tab") },
                    { value: ";", label: ";" },
                    { value: ",", label: "," },
                    { value: "|", label: "|" },
                    { value: " ", label: t("datasets.space") },
                  ]}
                  error={wrong("delimiter", "/import/delimiter")}
                />
                <NativeSelect size="xs" label={t("datasets.decimal")} {...register("decimal")} data={[".", ","]} error={wrong("decimal", "/import/decimal")} />
                <NativeSelect
                  size="xs"
                  label={t("importing.thousands")}
                  {...register("thousands")}
                  data={[
                    { value: "", label: t("importing.noThousands") },
                    { value: ".", label: "1.234" },
                    { value: ",", label: "1,234" },
                    { value: "'", label: "1'234" },
                    { value: " ", label: "1 234" },
                  ]}
                  error={wrong("thousands", "/import/thousands")}
                />
                <Controller control={control} name="header_lines" render={({ field }) => <NumberInput size="xs" w={120} label={t("datasets.header")} hideControls value={Number.isNaN(field.value) ? "" : field.value} onChange={(value) => field.onChange(value === "" ? NaN : Number(value))} error={wrong("header_lines", "/import/header_lines")} />} />
                <TextInput w={150} label={t("importing.missing")} placeholder="NaN; -" {...register("missing")} error={wrong("missing", "/import/missing")} />
                <TextInput w={140} label={t("importing.comment")} placeholder="#" {...register("comment")} error={wrong("comment", "/import/comment")} />
                <Checkbox mt={26} size="xs" label={t("importing.allowTruncated")} {...register("allow_truncated")} />
              </>
            )}
            <NativeSelect size="xs" label={t("importing.time")} {...register("time")} data={[{ value: "", label: t("importing.noTime") }, ...look.series.map((one) => ({ value: String(one.index), label: one.name || `${one.index + 1}` }))]} error={wrong("time", "/import/time")} />
            {watch("time") !== "" && <TextInput w={90} label={t("importing.timeUnit")} {...register("time_unit")} error={problem?.at("/import/time/unit")} />}
            {watch("time") !== "" && <NativeSelect size="xs" label={t("importing.order")} {...register("order")} data={(["", "ymd", "mdy", "dmy"] as const).map((value) => ({ value, label: t(`importing.orders.${value || "none"}`) }))} />}
            <Controller control={control} name="sample_rate" render={({ field }) => <NumberInput size="xs" w={150} label={t("datasets.rate")} hideControls suffix=" 1/s" value={field.value ?? ""} onChange={(value) => field.onChange(value === "" ? undefined : Number(value))} error={wrong("sample_rate", "/import/sample_rate")} />} />
            <NativeSelect size="xs" label={t("importing.gaps")} {...register("gaps")} data={(["fill", "close"] as const).map((value) => ({ value, label: t(`importing.gapKinds.${value}`) }))} />
            <UnevenFields wrong={wrong} />
            <TextInput w={170} label={t("schedules.zone")} {...register("time_zone")} error={wrong("time_zone", "/import/time_zone")} />
          </Group>
          {table && (
            <Button mt="sm" variant="default" onClick={() => onLook(layoutOf(getValues()))}>
              {t("importing.again")}
            </Button>
          )}
        </Paper>
        <GroupBoxes look={look} />
        <Table.ScrollContainer minWidth={900}>
          <Table>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>{t("datasets.take")}</Table.Th>
                <Table.Th>{t("importing.inFile")}</Table.Th>
                <Table.Th>{t("datasets.channel")}</Table.Th>
                <Table.Th>{t("importing.quantity")}</Table.Th>
                <Table.Th>{t("jobs.unit")}</Table.Th>
                <Table.Th>{t("datasets.scale")}</Table.Th>
                <Table.Th>{t("importing.offset")}</Table.Th>
                <Table.Th>{t("datasets.first")}</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {columns.map((column, i) => (
                <Table.Tr key={column.index}>
                  <Table.Td>
                    <Checkbox size="xs" {...register(`columns.${i}.take`)} aria-label={t("datasets.takeOf", { name: column.label })} />
                  </Table.Td>
                  <Table.Td>
                    {column.label} {look.series[i]?.unit ? `[${prettyUnit(look.series[i].unit)}]` : ""}
                    {column.group !== "" && (
                      <Text fz="xs" c="dimmed">
                        {column.group}
                      </Text>
                    )}
                    {/* Of a table of text only the beginning has been read: how many there are is not known yet. */}
                    {!!look.series[i]?.sample_count && (
                      <Text fz="xs" c="dimmed">
                        {t("importing.samples", { count: look.series[i].sample_count })}
                      </Text>
                    )}
                  </Table.Td>
                  <Table.Td>
                    <TextInput aria-label={t("datasets.nameOf", { number: column.index + 1 })} {...register(`columns.${i}.name`)} error={wrongCell(i, "name")} w={150} />
                  </Table.Td>
                  <Table.Td>
                    <TextInput aria-label={t("importing.quantityOf", { number: column.index + 1 })} {...register(`columns.${i}.quantity`)} error={wrongCell(i, "quantity")} w={120} />
                  </Table.Td>
                  <Table.Td>
                    <TextInput aria-label={t("datasets.unitOf", { number: column.index + 1 })} {...register(`columns.${i}.unit`)} error={wrongCell(i, "unit")} w={90} />
                  </Table.Td>
                  <Table.Td>{number(`columns.${i}.scale`, t("datasets.scaleOf", { number: column.index + 1 }), wrongCell(i, "scale"))}</Table.Td>
                  <Table.Td>{number(`columns.${i}.offset`, t("importing.offsetOf", { number: column.index + 1 }), wrongCell(i, "offset"))}</Table.Td>
                  <Table.Td className="numbers">{sample(column.index)}</Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        </Table.ScrollContainer>
        <Text fz="xs" c="dimmed">
          {t("importing.physical")}
        </Text>
        {formState.errors.columns?.root?.message || formState.errors.columns?.message ? (
          <Text fz="sm" c="var(--mantine-color-error)" role="alert">
            {t(formState.errors.columns.root?.message ?? formState.errors.columns.message ?? "")}
          </Text>
        ) : null}
        <ProblemAlert error={commit.error} shown={shown} />
        <Group>
          <Button type="submit" loading={commit.isPending}>
            {t("datasets.send")}
          </Button>
          <Button variant="default" onClick={() => onLook(null)}>
            {t("importing.propose")}
          </Button>
        </Group>
      </Stack>
    </form>
    </FormProvider>
  );
}
