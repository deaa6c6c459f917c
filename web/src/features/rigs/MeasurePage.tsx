import { Alert, Button, Checkbox, Group, Modal, NativeSelect, Paper, Stack, Text, TextInput } from "@mantine/core";
import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useState } from "react";
import { Controller, useForm } from "react-hook-form";
import { useTranslation } from "react-i18next";
import { Link, useNavigate, useParams, useSearchParams } from "react-router";
import { api, must } from "@/shared/api/client";
import { isProblem } from "@/shared/api/problem";
import { scheduleAt } from "@/shared/api/schedules";
import { faultAt } from "@/shared/forms/faults";
import { NumberField } from "@/shared/forms/NumberField";
import { readFields, writeFields } from "@/shared/forms/address";
import { useAddress } from "@/shared/forms/useAddress";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { formatNumber, withUnit } from "@/shared/units/format";
import { agentsQuery, presence, rigQuery, templatesQuery, type AcquisitionRequest, type Rig, type Template } from "./api";
import { delivered } from "./devices";
import { driveFaults, editable, fieldsOf, liveOf, plainTrigger, requestOf, resolver, schema, type Fields } from "./request";
import { TriggerFields } from "./TriggerFields";

/** The form of a measurement, filled from a template when the address names one. */
export function MeasurePage() {
  const { t } = useTranslation();
  const { id = "" } = useParams();
  const [query, setQuery] = useSearchParams();
  const rig = useQuery({ ...rigQuery(id), refetchInterval: false, staleTime: 60_000 });
  const templates = useQuery(templatesQuery);
  if (rig.isError || templates.isError) return <ProblemAlert error={rig.error ?? templates.error} m="md" onRetry={() => void rig.refetch()} />;
  if (!rig.data || !templates.data) return null;
  const own = templates.data.filter((template) => !template.document.rig || template.document.rig === rig.data.name);
  const template = own.find((one) => one.id === query.get("template"));
  return (
    <div className="page">
      <PageHead title={t("rigs.measureOn", { name: rig.data.name })} doc={t("rigs.measureDoc")} />
      <Paper withBorder p="md" maw={760}>
        <Stack gap="sm">
          {own.length > 0 && <NativeSelect size="xs" maw={320} label={t("rigs.fromTemplate")} value={template?.id ?? ""} onChange={(event) => setQuery(event.currentTarget.value ? { template: event.currentTarget.value } : {}, { replace: true, preventScrollReset: true })} data={[{ value: "", label: t("rigs.noTemplate") }, ...own.map((one) => ({ value: one.id, label: one.name }))]} />}
          <Form key={template ? `${template.id}@${template.revision}` : "new"} rig={rig.data} template={template} />
        </Stack>
      </Paper>
    </div>
  );
}

const SHOWN = ["/name", "/channels", "/sample_rate", "/duration", "/pre_trigger", "/averages"];

function Form({ rig, template }: { rig: Rig; template: Template | undefined }) {
  const { t } = useTranslation();
  const navigate = useNavigate();
  const queries = useQueryClient();
  const agents = useQuery(agentsQuery);
  const inputs = rig.document.inputs ?? [];
  const outputs = rig.document.outputs ?? [];
  const [query] = useSearchParams();
  const begin = fieldsOf(template?.document, inputs.map((input) => input.name));
  const held = { read: (at: URLSearchParams) => readFields(at, begin, schema.shape), write: (fields: Fields) => writeFields(fields, begin) };
  const form = useForm<Fields>({ resolver, defaultValues: held.read(query) });
  const { control, register, handleSubmit, watch } = form;
  useAddress(form, held);
  const [asked, setAsked] = useState<AcquisitionRequest | null>(null);
  const asIs = template !== undefined && !editable(template);
  const waitsAsIs = template !== undefined && !plainTrigger(template);
  const request = (fields: Fields): AcquisitionRequest => {
    const made = requestOf(fields, rig.name);
    return { ...made, ...(asIs ? { drive: template.document.drive! } : {}), ...(waitsAsIs ? { trigger: template.document.trigger! } : {}) };
  };
  const start = useMutation({
    mutationFn: (body: AcquisitionRequest) => must(api.POST("/v1/acquisitions", { body })),
    onSuccess: (made) => {
      void queries.invalidateQueries({ queryKey: ["acquisitions"] });
      void navigate(`/acquisitions/${made.id}`);
    },
    onSettled: () => setAsked(null),
  });
  const keep = useMutation({
    mutationFn: (body: AcquisitionRequest) => must(api.POST("/v1/acquisition-templates", { body })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["acquisition-templates"] }),
  });
  const error = start.error ?? keep.error;
  const problem = isProblem(error) ? error : null;
  const wrong = (field: keyof Fields) => faultAt(t, form, problem, field);
  const driven = driveFaults(problem);
  const wrongDrive = (field: keyof typeof driven) => faultAt(t, form, null, field) ?? driven[field];
  const values = watch();
  const agent = agents.data?.find((one) => one.id === rig.agent);
  const away = agents.isSuccess && (!agent || presence(agent) !== "ready");
  const output = outputs.find((one) => one.name === values.output);
  const wanted = new Set([...values.channels.map((name) => `input ${name}`), `output ${values.output}`]);
  // What the agent found when it tried them: it will be refused.
  const misfits = (rig.document.findings ?? []).filter((finding) => finding.result === "fails" && wanted.has(finding.what));
  const measure = handleSubmit((fields) => {
    const body = request(fields);
    // What moves something is asked about first; listening moves nothing.
    if (body.drive) setAsked(body);
    else start.mutate(body);
  });
  const show = () => {
    if (!values.name.trim()) form.setValue("name", t("rigs.liveName"));
    void handleSubmit((fields) => start.mutate({ ...liveOf(fields, rig.name), ...(waitsAsIs ? { trigger: template.document.trigger! } : {}) }))();
  };
  return (
    <form onSubmit={(event) => void measure(event)} noValidate>
      <Stack gap="sm">
        {away && (
          <Alert color="orange" variant="outline" title={t("rigs.awayTitle")}>
            {t("rigs.awayDoc")}
          </Alert>
        )}
        <TextInput label={t("systems.name")} {...register("name")} error={wrong("name")} />
        <Controller
          control={control}
          name="channels"
          render={({ field }) => (
            <Checkbox.Group label={t("rigs.inputs")} value={field.value} onChange={field.onChange} error={wrong("channels")}>
              <Group gap="md" mt={4}>
                {inputs.map((input) => (
                  <Checkbox key={input.name} value={input.name} label={input.name} size="xs" />
                ))}
              </Group>
            </Checkbox.Group>
          )}
        />
        {values.output && rig.document.understands?.includes("commanded") && !inputs.some((input) => input.name === values.output) && <Checkbox size="xs" label={t("rigs.commanded", { output: values.output })} description={t("rigs.commandedDoc")} {...register("commanded")} />}
        {misfits.map((finding) => (
          <Text key={finding.what} fz="xs" c="red">
            {t("rigs.misfit", { what: finding.what, told: finding.told, remedy: finding.remedy })}
          </Text>
        ))}
        <Group grow preventGrowOverflow={false} align="flex-start">
          <NumberField control={control} name="duration" label={t("rigs.duration")} unit="s" error={wrong("duration")} />
          <NumberField control={control} name="sample_rate" label={t("datasets.rate")} unit="1/s" error={wrong("sample_rate")} />
          <NumberField control={control} name="pre_trigger" label={t("rigs.preTrigger")} unit="s" error={wrong("pre_trigger")} />
          <NumberField control={control} name="averages" label={t("rigs.averages")} error={wrong("averages")} />
        </Group>
        {asIs ? (
          <Text fz="sm">{t("rigs.asTemplate", { output: template.document.drive!.output, kind: template.document.drive!.signal.kind })}</Text>
        ) : (
          <>
            <Group grow preventGrowOverflow={false} align="flex-start">
              <NativeSelect size="xs" label={t("rigs.drives")} {...register("output")} error={wrongDrive("output")} data={[{ value: "", label: t("rigs.nothing") }, ...outputs.map((one) => ({ value: one.name, label: one.name }))]} />
              {values.output && <NativeSelect size="xs" label={t("rigs.signal")} {...register("signal")} data={(["step", "sine", "chirp"] as const).map((kind) => ({ value: kind, label: t(`rigs.signals.${kind}`) }))} />}
              {values.output && <NumberField control={control} name="amplitude" label={t("rigs.amplitude")} unit={output ? delivered(output) : "V"} error={wrongDrive("amplitude")} />}
              {values.output && values.signal !== "step" && <NumberField control={control} name="frequency" label={t(values.signal === "chirp" ? "rigs.fromFrequency" : "rigs.frequency")} unit="Hz" error={wrongDrive("frequency")} />}
              {values.output && values.signal === "chirp" && <NumberField control={control} name="end" label={t("rigs.toFrequency")} unit="Hz" error={wrongDrive("end")} />}
            </Group>
            {output && (
              <Text fz="xs" c="dimmed">
                {output.kind === "digital" ? t("rigs.allowedLine", { name: output.name, safe: output.safe }) : t("rigs.allowed", { name: output.name, unit: delivered(output), amplitude: formatNumber(output.amplitude), slew: formatNumber(output.slew ?? Infinity), duration: formatNumber(output.duration ?? Infinity) })}
              </Text>
            )}
          </>
        )}
        {waitsAsIs ? <Text fz="sm">{t("rigs.waitsAsTemplate", { channel: template.document.trigger!.channel })}</Text> : !asIs && values.output === "" && <TriggerFields form={form} inputs={inputs} problem={problem} />}
        <Checkbox size="xs" label={t("rigs.confirm")} description={t("rigs.confirmDoc")} {...register("confirm")} />
        <ProblemAlert error={error} shown={[...SHOWN, ...(asIs ? [] : ["/drive"]), ...(waitsAsIs || asIs || values.output !== "" ? [] : ["/trigger"])]} />
        {keep.isSuccess && (
          <Text fz="sm" role="status">
            {t("rigs.kept", { name: keep.data.name })}
          </Text>
        )}
        <Group>
          <Button type="submit" loading={start.isPending && asked === null}>
            {t("rigs.start")}
          </Button>
          <Button variant="default" onClick={show}>
            {t("rigs.live")}
          </Button>
          <Button variant="default" onClick={() => void handleSubmit((fields) => keep.mutate(request(fields)))()} loading={keep.isPending}>
            {t("rigs.keep")}
          </Button>
          <Button variant="default" onClick={() => void handleSubmit((fields) => navigate(scheduleAt(fields.name, { kind: "acquisition", body: { ...request(fields), confirm: false } })))()}>
            {t("schedules.new")}
          </Button>
          <Button variant="default" component={Link} to={`/rigs/${rig.id}`}>
            {t("schedules.back")}
          </Button>
        </Group>
      </Stack>
      <Modal opened={asked !== null} onClose={() => setAsked(null)} title={t("rigs.askTitle", { name: rig.name })} closeButtonProps={{ "aria-label": t("datasets.close") }}>
        <Stack gap="sm">
          <Text fz="sm">{asked?.drive && t("rigs.ask", { output: asked.drive.output, level: asIs ? "" : withUnit(Math.abs(values.amplitude), output ? delivered(output) : "V"), duration: formatNumber(values.duration * values.averages) })}</Text>
          <Text fz="sm">{t(values.confirm ? "rigs.askConfirmed" : "rigs.askAlone")}</Text>
          <Group>
            <Button onClick={() => asked && start.mutate(asked)} loading={start.isPending} data-autofocus>
              {t("rigs.go")}
            </Button>
            <Button variant="default" onClick={() => setAsked(null)}>
              {t("rigs.not")}
            </Button>
          </Group>
        </Stack>
      </Modal>
    </form>
  );
}
