import { zodResolver } from "@hookform/resolvers/zod";
import { Alert, Autocomplete, Button, Group, NativeSelect, Paper, Stack, Switch, Textarea, TextInput } from "@mantine/core";
import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useMemo } from "react";
import { Controller, useForm } from "react-hook-form";
import { useTranslation } from "react-i18next";
import { Link, useNavigate, useParams, useSearchParams } from "react-router";
import { z } from "zod";
import { api, must } from "@/shared/api/client";
import { isProblem, type Problem } from "@/shared/api/problem";
import { scheduleQuery, type ScheduledJob, type ScheduleRequest } from "@/shared/api/schedules";
import { readFields, writeFields } from "@/shared/forms/address";
import { faultAt } from "@/shared/forms/faults";
import { useAddress } from "@/shared/forms/useAddress";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { cronWords, PRESETS, timeZones } from "./cron";

const KINDS = ["optimization", "identification", "validation", "acquisition"] as const;
/** Kinds of jobs that are about a recording. */
const DATA_OF = new Set<string>(["identification", "validation"]);
const SHOWN = ["/name", "/cron", "/time_zone", "/newest", "/job"];

function jsonObject(text: string): Record<string, unknown> | null {
  try {
    const found: unknown = JSON.parse(text);
    return typeof found === "object" && found !== null && !Array.isArray(found) ? (found as Record<string, unknown>) : null;
  } catch {
    return null;
  }
}

const schema = z.object({
  name: z.string().trim().min(1, "forms.required").max(200, "forms.longest 200"),
  cron: z.string().refine((text) => cronWords(text, "en") !== null, "schedules.cronWrong"),
  time_zone: z.string().min(1, "forms.required"),
  kind: z.enum(KINDS),
  body: z.string().refine((text) => jsonObject(text) !== null, "schedules.bodyWrong"),
  overlap: z.enum(["skip", "queue", "cancel_previous"]),
  missed: z.enum(["none", "one", "all"]),
  newest: z.string(),
  paused: z.boolean(),
});
type Fields = z.infer<typeof schema>;

/** The form of a new schedule, and of one that is changed; what it runs comes from any page that has such a request. */
export function ScheduleFormPage() {
  const { t } = useTranslation();
  const { id } = useParams();
  const [query] = useSearchParams();
  const existing = useQuery({ ...scheduleQuery(id ?? ""), enabled: id !== undefined, refetchInterval: false, staleTime: Infinity });
  if (existing.isError) return <ProblemAlert error={existing.error} m="md" onRetry={() => void existing.refetch()} />;
  if (id !== undefined && !existing.data) return null;
  const given = jsonObject(query.get("job") ?? "") as unknown as ScheduledJob | null;
  const document = existing.data?.document;
  const job = document?.job ?? given;
  const begin: Fields = {
    name: document?.name ?? "",
    cron: document?.cron ?? PRESETS.nightly,
    time_zone: document?.time_zone ?? Intl.DateTimeFormat().resolvedOptions().timeZone,
    kind: job?.kind ?? "acquisition",
    body: JSON.stringify(job?.body ?? {}, null, 2),
    overlap: document?.overlap ?? "skip",
    missed: document?.missed ?? "one",
    newest: document?.newest ?? "",
    paused: document?.paused ?? false,
  };
  return (
    <div className="page">
      <PageHead title={document ? t("schedules.editOf", { name: document.name }) : t("schedules.new")} doc={t("schedules.formDoc")} />
      <Form key={existing.data?.etag ?? "new"} begin={begin} id={id} etag={existing.data?.etag} onAnew={() => void existing.refetch()} />
    </div>
  );
}

function Form({ begin, id, etag, onAnew }: { begin: Fields; id: string | undefined; etag: string | undefined; onAnew(): void }) {
  const { t, i18n } = useTranslation();
  const navigate = useNavigate();
  const queries = useQueryClient();
  const [query] = useSearchParams();
  const held = { read: (at: URLSearchParams) => readFields(at, begin, schema.shape), write: (fields: Fields) => writeFields(fields, begin) };
  const form = useForm<Fields>({ resolver: zodResolver(schema), defaultValues: held.read(query) });
  const { register, control, handleSubmit, watch, setValue } = form;
  useAddress(form, held);
  const zones = useMemo(timeZones, []);
  const templates = useQuery({ queryKey: ["acquisition-templates"], queryFn: () => must(api.GET("/v1/acquisition-templates", { params: { query: { limit: 200 } } })) });
  const save = useMutation({
    mutationFn: async ({ kind, body, newest, ...rest }: Fields) => {
      const document = { ...rest, newest: (DATA_OF.has(kind) && newest.trim()) || null, job: { kind, body: jsonObject(body) } } as unknown as ScheduleRequest;
      if (id !== undefined && etag !== undefined) return must(api.PUT("/v1/schedules/{identifier}", { params: { path: { identifier: id }, header: { "If-Match": etag } }, body: document }));
      return must(api.POST("/v1/schedules", { body: document }));
    },
    onSuccess: (saved) => {
      void queries.invalidateQueries({ queryKey: ["schedules"] });
      void queries.invalidateQueries({ queryKey: ["schedule", saved.id] });
      void navigate(`/schedules/${saved.id}`);
    },
  });
  const problem: Problem | null = isProblem(save.error) ? save.error : null;
  const wrong = (field: keyof Fields, pointer: string) => faultAt(t, form, problem, field, pointer);
  const { cron, kind } = watch();
  return (
    <Paper withBorder p="md" maw={760}>
      <form onSubmit={(event) => void handleSubmit((value) => save.mutate(value))(event)} noValidate>
        <Stack gap="sm">
          <TextInput label={t("systems.name")} {...register("name")} error={wrong("name", "/name")} />
          <Group align="flex-start" grow preventGrowOverflow={false}>
            <TextInput label={t("schedules.cron")} description={cronWords(cron, i18n.language) ?? t("schedules.cronParts")} {...register("cron")} error={wrong("cron", "/cron")} classNames={{ input: "numbers" }} />
            <NativeSelect size="xs" label={t("schedules.preset")} description={t("schedules.presetDoc")} value={Object.values(PRESETS).some((known) => known === cron) ? cron : ""} onChange={(event) => event.currentTarget.value && setValue("cron", event.currentTarget.value, { shouldValidate: true })} data={[{ value: "", label: "–" }, ...Object.entries(PRESETS).map(([name, value]) => ({ value, label: t(`schedules.presets.${name}`) }))]} />
            <Controller control={control} name="time_zone" render={({ field }) => <Autocomplete size="xs" label={t("schedules.zone")} description={t("schedules.zoneDoc")} data={zones} limit={40} value={field.value} onChange={field.onChange} onBlur={field.onBlur} error={wrong("time_zone", "/time_zone")} />} />
          </Group>
          <Group align="flex-end">
            <NativeSelect size="xs" label={t("schedules.what")} {...register("kind")} data={KINDS.map((value) => ({ value, label: t(`jobs.kinds.${value}`) }))} />
            {kind === "acquisition" && (
              <NativeSelect size="xs" label={t("schedules.template")} value="" onChange={(event) => event.currentTarget.value && setValue("body", JSON.stringify({ template: event.currentTarget.value }, null, 2), { shouldValidate: true })} data={[{ value: "", label: t("schedules.choose") }, ...(templates.data?.items ?? []).map((row) => ({ value: row.id, label: row.name }))]} />
            )}
          </Group>
          <Textarea label={t("schedules.body")} description={t(`schedules.bodyDoc.${kind}`)} autosize minRows={6} maxRows={22} {...register("body")} error={wrong("body", "/job")} classNames={{ input: "numbers" }} spellCheck={false} />
          {DATA_OF.has(kind) && <TextInput label={t("schedules.newest")} description={t("schedules.newestDoc")} {...register("newest")} error={wrong("newest", "/newest")} />}
          <Group grow preventGrowOverflow={false}>
            <NativeSelect size="xs" label={t("schedules.overlap")} {...register("overlap")} data={(["skip", "queue", "cancel_previous"] as const).map((value) => ({ value, label: t(`schedules.overlapNames.${value}`) }))} />
            <NativeSelect size="xs" label={t("schedules.missed")} {...register("missed")} data={(["none", "one", "all"] as const).map((value) => ({ value, label: t(`schedules.missedNames.${value}`) }))} />
          </Group>
          <Switch size="xs" label={t("schedules.beginPaused")} {...register("paused")} />
          {!isProblem(save.error, 412) && <ProblemAlert error={save.error} shown={SHOWN} />}
          {isProblem(save.error, 412) && (
            <Alert color="orange" variant="outline" title={t("schedules.changedMeanwhile")}>
              <Stack gap="xs" align="flex-start">
                {t("schedules.changedDoc")}
                <Button variant="default" onClick={onAnew}>
                  {t("schedules.anew")}
                </Button>
              </Stack>
            </Alert>
          )}
          <Group>
            <Button type="submit" loading={save.isPending}>
              {t("schedules.save")}
            </Button>
            <Button variant="default" component={Link} to={id === undefined ? "/schedules" : `/schedules/${id}`}>
              {t("schedules.back")}
            </Button>
          </Group>
        </Stack>
      </form>
    </Paper>
  );
}
