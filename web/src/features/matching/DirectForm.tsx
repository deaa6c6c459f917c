import { Select, Stack } from "@mantine/core";
import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { useNavigate } from "react-router";
import { api, must } from "@/shared/api/client";
import { datasetQuery, readyDatasets } from "@/shared/api/datasets";
import { isProblem } from "@/shared/api/problem";
import { contractQuery } from "@/shared/forms/contract";
import { SchemaFields } from "@/shared/forms/SchemaFields";
import { bodyOf, missing, type Values } from "@/shared/forms/schema";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { useQueryText } from "@/shared/ui/useQueryText";
import { directFields, readValues, type Direct } from "./direct";
import { StartButtons } from "./parts";
import { channelsOf } from "./sources";

/** A model out of a recording alone: the fields are those of the contract, and stand in the address. */
export function DirectForm({ method }: { method: Direct }) {
  const { t } = useTranslation();
  const navigate = useNavigate();
  const queries = useQueryClient();
  const [query, setQuery] = useQueryText();
  const [empty, setEmpty] = useState<string[]>([]);
  const contract = useQuery(contractQuery);
  const choices = useQuery(readyDatasets);
  const id = query.get("dataset") ?? "";
  const dataset = useQuery({ ...datasetQuery(id), enabled: id !== "" });
  const fields = contract.data ? directFields(contract.data, method) : [];
  const values = readValues(query);
  const start = useMutation({
    mutationFn: () => must(api.POST("/v1/identifications", { body: { method, dataset: id, ...bodyOf(fields, values) } as never })),
    onSuccess: (job) => {
      void queries.invalidateQueries({ queryKey: ["jobs"] });
      void navigate(`/jobs/${job.id}`);
    },
  });
  const change = (key: string, value: string) =>
    setQuery((next) => {
      next.set(key, value);
      return next;
    });
  const fill = (next: Values) => {
    setEmpty([]);
    start.reset();
    change("f", JSON.stringify(next));
  };
  const problem = isProblem(start.error) ? start.error : null;
  const shown = ["/dataset", ...fields.map(({ name }) => `/${name}`)];
  return (
    <form
      noValidate
      onSubmit={(event) => {
        event.preventDefault();
        const gaps = missing(fields, values);
        setEmpty(gaps);
        if (gaps.length === 0) start.mutate();
      }}
    >
      <Stack gap="sm">
        <Select label={t("matching.dataset")} data={(choices.data ?? []).map((row) => ({ value: row.id, label: row.name }))} value={id || null} onChange={(value) => value && change("dataset", value)} searchable maw={420} error={problem?.at("/dataset")} />
        <ProblemAlert error={contract.error ?? choices.error ?? dataset.error} />
        {dataset.data && fields.length > 0 && (
          <>
            <SchemaFields fields={fields} values={values} channels={channelsOf(dataset.data).map(({ name }) => name)} onChange={fill} wrong={(field) => (empty.includes(field) ? t("forms.required") : problem?.at(`/${field}`))} />
            <ProblemAlert error={start.error} shown={shown} />
            <StartButtons go={t("matching.find")} busy={start.isPending} />
          </>
        )}
      </Stack>
    </form>
  );
}
