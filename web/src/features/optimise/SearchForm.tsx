import { zodResolver } from "@hookform/resolvers/zod";
import { Button, CopyButton, Group, Stack } from "@mantine/core";
import { useMutation } from "@tanstack/react-query";
import { useState } from "react";
import { get, useForm, type FieldPath } from "react-hook-form";
import { useTranslation } from "react-i18next";
import { Link, useNavigate } from "react-router";
import { api, must } from "@/shared/api/client";
import { Problem } from "@/shared/api/problem";
import type { components } from "@/shared/api/schema";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { useQueryText } from "@/shared/ui/useQueryText";
import { addressOf } from "./address";
import { curlOf, pythonOf } from "./copy";
import { Experiments } from "./Experiments";
import type { Bounded } from "./first";
import type { Part } from "./form";
import { Goals } from "./Goals";
import { Method } from "./Method";
import { Preview } from "./Preview";
import { bodyOf, rowsOf } from "./problem";
import { Robustness } from "./Robustness";
import { Structures } from "./Structures";
import { fieldOf, search, type Search } from "./schema";
import classes from "./SearchForm.module.css";
import { useFirstFault } from "./useFirstFault";
import { Variables } from "./Variables";

type Props = Omit<Part, "form" | "change" | "faultAt"> & { id: string; revision: number; given: Search; effort: Bounded | null };

/** A search as a form: the address holds it, it checks itself, and what the service finds wrong stands at its field. */
export function SearchForm({ id, revision, given, effort, ...known }: Props) {
  const { t } = useTranslation();
  const navigate = useNavigate();
  const [, setQuery] = useQueryText();
  const { watch, getValues, setValue, setError, clearErrors, handleSubmit, formState } = useForm<Search>({ resolver: zodResolver(search), defaultValues: given });
  const [placed, setPlaced] = useState<string[]>([]);
  const first = useFirstFault();
  const form = watch();
  const domains = { get: (name: string) => known.metrics.get(name)?.domain };
  const change = (part: Partial<Search>) => {
    for (const [key, value] of Object.entries(part)) {
      clearErrors(key as keyof Search);
      setValue(key as keyof Search, value as never);
    }
    setQuery(() => new URLSearchParams({ f: addressOf(id, getValues()) }));
  };
  const submit = useMutation({
    mutationFn: (asked: Search) => must(api.POST("/v1/optimizations", { body: bodyOf(asked, id, domains) as components["schemas"]["OptimizationRequest"] })),
    onSuccess: (job) => void navigate(`/jobs/${job.id}`),
    // What the service finds wrong is told at the field it belongs to; the rest above the form.
    onError: (error, asked) => {
      const faults = (error instanceof Problem && error.document.errors) || [];
      const rows = rowsOf(asked, domains);
      const own = faults.flatMap((fault) => {
        const field = fieldOf(fault.pointer, rows);
        return field === null ? [] : [{ ...fault, field }];
      });
      for (const { field, detail } of own) setError(field as FieldPath<Search>, { type: "service", message: detail });
      setPlaced(own.map((fault) => fault.pointer));
      first.tell();
    },
  });
  const faultAt = (field: string): string | undefined => {
    const message = (get(formState.errors, field) as { message?: string } | undefined)?.message;
    return message === undefined ? undefined : t(message, message);
  };
  const body = bodyOf(form, id, domains);
  const part: Part = { ...known, form, change, faultAt };
  return (
    <div className={`page ${classes.page}`}>
      <form
        ref={first.form}
        noValidate
        onSubmit={(event) => {
          clearErrors();
          setPlaced([]);
          void handleSubmit((asked) => submit.mutate(asked), first.tell)(event);
        }}
      >
        <Stack gap="lg">
          <ProblemAlert error={submit.error} shown={placed} />
          <Variables {...part} />
          <Experiments {...part} />
          <Goals {...part} effort={effort} />
          <Robustness {...part} system={id} />
          <Structures {...part} system={id} />
          <Method {...part} />
          <Group>
            <Button type="submit" size="sm" data-tour-of="optimise" loading={submit.isPending} disabled={form.variables.length === 0 || form.goals.length === 0}>
              {t("optimise.start")}
            </Button>
            <CopyButton value={pythonOf(body, location.origin)}>{({ copied, copy }) => <Button variant="default" onClick={copy}>{copied ? t("optimise.copied") : t("optimise.python")}</Button>}</CopyButton>
            <CopyButton value={curlOf(body, location.origin)}>{({ copied, copy }) => <Button variant="default" onClick={copy}>{copied ? t("optimise.copied") : t("optimise.curl")}</Button>}</CopyButton>
            <Button variant="default" component={Link} to={`/schedules/new?job=${encodeURIComponent(JSON.stringify({ kind: "optimization", body }))}`}>
              {t("optimise.schedule")}
            </Button>
          </Group>
        </Stack>
      </form>
      <Preview {...part} id={id} revision={revision} />
    </div>
  );
}
