import type { TFunction } from "i18next";
import { get, type FieldPath, type FieldValues, type UseFormReturn } from "react-hook-form";
import type { Problem } from "@/shared/api/problem";

/**
 * The sentence at a field: what the form itself finds wrong, with the rule and with what was entered; otherwise what the service
 * said of the place in the request. A message of a schema is a key of the texts and, behind a space, the limit that it speaks of.
 */
export function faultAt<Fields extends FieldValues>(t: TFunction, form: Pick<UseFormReturn<Fields>, "formState" | "getValues">, problem: Problem | null, field: FieldPath<Fields>, pointer = `/${field.replaceAll(".", "/")}`, factor = 1): string | undefined {
  const { message } = (get(form.formState.errors, field) ?? {}) as { message?: string };
  if (!message) return problem?.at(pointer);
  return ruleAndValue(t, message, form.getValues(field), factor);
}

/** `must be greater than 0, got −3`. */
export function ruleAndValue(t: TFunction, message: string, value: unknown, factor = 1): string {
  const [key = "", limit] = message.split(" ");
  const rule = t(key, { limit });
  const shown = typeof value === "number" && !Number.isNaN(value) ? String(Math.round((value / factor) * 1e9) / 1e9) : typeof value === "string" ? value.trim() : "";
  return shown === "" ? rule : t("forms.got", { rule, value: shown.length > 60 ? `${shown.slice(0, 60)}…` : shown });
}

/** The properties of a field whose fault is shown elsewhere, beneath its row: it is marked, and whoever only hears the page is told there, too. */
export function toldElsewhere(fault: string | undefined): { error?: string; errorProps?: { display: "none" } } {
  return fault === undefined ? {} : { error: fault, errorProps: { display: "none" } };
}
