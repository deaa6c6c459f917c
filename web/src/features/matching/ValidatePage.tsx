import { zodResolver } from "@hookform/resolvers/zod";
import { Group, NativeSelect, Paper, Stack, Text, TextInput } from "@mantine/core";
import { useMutation, useQueryClient } from "@tanstack/react-query";
import { useForm } from "react-hook-form";
import { useTranslation } from "react-i18next";
import { useNavigate, useSearchParams } from "react-router";
import { z } from "zod";
import { api, must } from "@/shared/api/client";
import { isProblem } from "@/shared/api/problem";
import { scheduleAt } from "@/shared/api/schedules";
import { readFields, writeFields } from "@/shared/forms/address";
import { faultAt } from "@/shared/forms/faults";
import { NumberField } from "@/shared/forms/NumberField";
import { useAddress } from "@/shared/forms/useAddress";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { driven, given, placesOf } from "./address";
import { MatchFields, useMatch } from "./MatchFields";
import { OffsetsSelect, StartButtons } from "./parts";

const second = z.number("forms.number").min(0, "forms.notNegative").optional();
const schema = z
  .object({
    limit: z.number("forms.number").positive("forms.positive").max(100, "forms.atMost 100"),
    offsets: z.enum(["none", "estimate"]),
    diagnose: z.enum(["failed", "always", "never"]),
    identification: z.string().trim(),
    from: second,
    to: second,
  })
  .refine(({ from, to }) => (from === undefined) === (to === undefined) && (from === undefined || from < to!), { path: ["to"], message: "matching.windowWrong" });
type Fields = z.infer<typeof schema>;

const BEGIN: Fields = { limit: 10, offsets: "none", diagnose: "failed", identification: "", from: undefined, to: undefined };
const HELD = { read: (query: URLSearchParams) => readFields(query, BEGIN, schema.shape), write: (fields: Fields) => writeFields(fields, BEGIN) };

const SHOWN = ["/system", "/limit_percent", "/identification", "/window"];
/** Points of each curve that a page can show. */
const POINTS = 4000;

/** Which model is held against which recording, and what counts as agreement. */
export function ValidatePage() {
  const { t } = useTranslation();
  const found = useMatch();
  return (
    <div className="page">
      <PageHead title={t("matching.validate")} doc={t("matching.validateDoc")} />
      <Paper withBorder p="md" maw={860}>
        <Form found={found} />
      </Paper>
    </div>
  );
}

function Form({ found }: { found: ReturnType<typeof useMatch> }) {
  const { t } = useTranslation();
  const navigate = useNavigate();
  const queries = useQueryClient();
  const [query] = useSearchParams();
  const form = useForm<Fields>({ resolver: zodResolver(schema), defaultValues: HELD.read(query) });
  const { control, register, handleSubmit } = form;
  useAddress(form, HELD);
  const bodyOf = ({ limit, identification, from, to, ...rest }: Fields) => ({
    system: found.match.system,
    dataset: found.match.dataset,
    inputs: driven(found.match),
    outputs: given(found.match.outputs),
    limit_percent: limit,
    ...rest,
    ...(identification ? { identification } : {}),
    ...(from !== undefined && to !== undefined ? { window: [from, to] } : {}),
    points: POINTS,
  });
  const start = useMutation({
    mutationFn: async (fields: Fields) => {
      const made = await must(api.POST("/v1/validations", { params: { header: { prefer: "respond-async" } }, body: bodyOf(fields) as never }));
      return (made as { id: string }).id;
    },
    onSuccess: (id) => {
      void queries.invalidateQueries({ queryKey: ["jobs"] });
      void navigate(`/jobs/${id}`);
    },
  });
  const problem = isProblem(start.error) ? start.error : null;
  const wrong = (pointer: string) => problem?.at(pointer);
  const own = (field: keyof Fields, pointer: string) => faultAt(t, form, problem, field, pointer);
  const seconds = (name: "from" | "to", label: string, error: string | undefined) => <NumberField control={control} name={name} w={110} label={label} unit="s" optional error={error} />;
  return (
    <form onSubmit={(event) => void handleSubmit((fields) => start.mutate(fields))(event)} noValidate>
      <Stack gap="sm">
        <MatchFields {...found} wrong={wrong} />
        {found.opened && found.dataset && (
          <>
            <Group align="flex-start">
              <NumberField control={control} name="limit" w={190} label={t("matching.limit")} description={t("matching.limitDoc")} unit="%" error={own("limit", "/limit_percent")} />
              <OffsetsSelect {...register("offsets")} />
              <NativeSelect size="xs" w={190} label={t("matching.diagnose")} description={t("matching.diagnoseDoc")} {...register("diagnose")} data={(["failed", "always", "never"] as const).map((value) => ({ value, label: t(`matching.diagnoses.${value}`) }))} />
            </Group>
            <Group align="flex-start">
              <TextInput w={300} label={t("matching.identification")} description={t("matching.identificationDoc")} {...register("identification")} error={own("identification", "/identification")} classNames={{ input: "numbers" }} />
              {seconds("from", t("datasets.from"), own("from", "/window"))}
              {seconds("to", t("datasets.to"), own("to", "/window"))}
            </Group>
            <Text fz="xs" c="dimmed">
              {t("matching.windowDoc")}
            </Text>
            <ProblemAlert error={start.error} shown={[...SHOWN, ...placesOf(found.opened)]} />
            <StartButtons go={t("matching.judge")} busy={start.isPending} onSchedule={() => void handleSubmit((fields) => navigate(scheduleAt(t("matching.validate"), { kind: "validation", body: bodyOf(fields) })))()} />
          </>
        )}
      </Stack>
    </form>
  );
}
