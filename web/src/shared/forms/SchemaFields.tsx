import { Checkbox, Group, MultiSelect, NativeSelect, TextInput, type TextInputProps } from "@mantine/core";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import type { Scalar } from "@/shared/api/types";
import { NumberEntry, shownScalar } from "@/shared/ui/NumberEntry";
import { useDraft } from "@/shared/ui/useDraft";
import { prettyUnit, words } from "@/shared/units/format";
import { readEntry } from "@/shared/units/number";
import type { Field, Values } from "./schema";

interface Props {
  fields: Field[];
  values: Values;
  /** Channels that may be chosen. */
  channels: string[];
  onChange(values: Values): void;
  wrong(field: string): string | undefined;
}

/** The fields of a request, side by side. */
export function SchemaFields({ fields, values, channels, onChange, wrong }: Props) {
  return (
    <Group align="flex-start" gap="sm">
      {fields.map((field) => (
        <SchemaField key={field.name} field={field} value={values[field.name]} channels={channels} error={wrong(field.name)} onChange={(value) => onChange({ ...values, [field.name]: value })} />
      ))}
    </Group>
  );
}

function SchemaField({ field, value, channels, error, onChange }: { field: Field; value: unknown; channels: string[]; error: string | undefined; onChange(value: unknown): void }) {
  const { t } = useTranslation();
  const { name, kind, unit, required, otherwise } = field;
  const label = t(`fields.${name}`, words(name));
  const common = { label, description: t(`fieldDocs.${name}`, field.doc) || undefined, error, required, withAsterisk: required, w: 220 };
  const placeholder = otherwise === undefined || otherwise === null || typeof otherwise === "object" ? undefined : String(otherwise);
  switch (kind) {
    case "number":
    case "integer":
    case "quantity":
      return <NumberEntry {...common} required={false} value={value as Scalar | undefined} unit={unit} optional placeholder={placeholder} onCommit={onChange} />;
    case "window":
      return <Span label={label} description={common.description} error={error} value={value as Scalar[] | undefined} unit={unit} onChange={onChange} />;
    case "edges":
      return <ListEntry {...common} required={false} value={value} unit={unit} onChange={(list) => onChange(list.length === 1 ? list[0] : list)} />;
    case "integers":
      return <ListEntry {...common} required={false} value={value} unit="" placeholder={Array.isArray(otherwise) ? otherwise.join("; ") : undefined} onChange={onChange} />;
    case "choice":
      return <NativeSelect {...common} size="xs" value={String(value ?? otherwise ?? "")} onChange={(event) => onChange(event.currentTarget.value || undefined)} data={[...(otherwise === undefined ? [{ value: "", label: t("forms.choose") }] : []), ...field.choices.map((choice) => ({ value: choice, label: t(`choices.${choice}`, words(choice)) }))]} />;
    case "flag":
      return <Checkbox size="xs" mt={22} label={label} description={common.description} checked={Boolean(value ?? otherwise)} onChange={(event) => onChange(event.currentTarget.checked)} error={error} w={220} />;
    case "channel":
      return <NativeSelect {...common} size="xs" value={String(value ?? "")} onChange={(event) => onChange(event.currentTarget.value || undefined)} data={[{ value: "", label: t("forms.choose") }, ...channels]} />;
    case "channels":
      return <MultiSelect {...common} required={false} searchable data={channels} value={(value as string[] | undefined) ?? []} onChange={onChange} />;
    case "ports":
      // A channel keeps its own name, in small letters, as the name of what it is.
      return <MultiSelect {...common} required={false} searchable data={channels} value={Object.values((value as Record<string, string> | undefined) ?? {})} onChange={(chosen) => onChange(Object.fromEntries(chosen.map((channel) => [portName(channel), channel])))} />;
    default:
      return <TextInput {...common} required={false} value={String(value ?? "")} onChange={(event) => onChange(event.currentTarget.value || undefined)} placeholder={placeholder} />;
  }
}

/** A channel's name as the contract wants the names of ports. */
export function portName(channel: string): string {
  const plain = channel.toLowerCase().replaceAll(/[^a-z0-9]+/g, "_").replaceAll(/^_+|_+$/g, "");
  return /^[a-z]/.test(plain) ? plain : `x_${plain}`;
}

function Span({ label, description, error, value, unit, onChange }: { label: string; description: string | undefined; error: string | undefined; value: Scalar[] | undefined; unit: string; onChange(value: unknown): void }) {
  const { t } = useTranslation();
  const [from, to] = value ?? [];
  const put = (next: (Scalar | undefined)[]) => onChange(next.every((one) => one === undefined) ? undefined : next);
  return (
    <Group gap={4} align="flex-start" wrap="nowrap">
      <NumberEntry label={label} description={description} value={from} unit={unit} optional placeholder={t("datasets.from")} error={error} onCommit={(next) => put([next, to])} w={120} aria-label={`${label}: ${t("datasets.from")}`} />
      <NumberEntry label={" "} description={description ? " " : undefined} value={to} unit={unit} optional placeholder={t("datasets.to")} onCommit={(next) => put([from, next])} w={120} aria-label={`${label}: ${t("datasets.to")}`} />
    </Group>
  );
}

/** Several numbers in one entry, with semicolons between them: `10 Hz; 50 Hz`. */
export function ListEntry({ value, unit, onChange, error, errorProps, ...rest }: { label: string; "aria-label"?: string; errorProps?: TextInputProps["errorProps"]; description?: string | undefined; error?: string | undefined; placeholder?: string | undefined; value: unknown; unit: string; onChange(list: Scalar[]): void; w?: number; withAsterisk?: boolean; required?: boolean }) {
  const { t } = useTranslation();
  const given = (Array.isArray(value) ? value : value === undefined ? [] : [value]).map(shownScalar).join("; ");
  const { text, type, take } = useDraft(given);
  const [wrong, setWrong] = useState(false);
  const commit = () => {
    if (!take()) return;
    const entries = text.split(";").filter((part) => part.trim() !== "").map((part) => readEntry(part, unit));
    const bad = entries.some(({ kind }) => kind !== "number" && kind !== "quantity");
    setWrong(bad);
    if (!bad && text !== given) onChange(entries.map((entry) => (entry.kind === "quantity" ? { value: entry.value, unit: entry.unit } : (entry as { value: number }).value)));
  };
  return <TextInput {...rest} value={text} onChange={(event) => type(event.currentTarget.value)} onBlur={commit} onKeyDown={(event) => { if (event.key === "Enter") { event.preventDefault(); commit(); } }} error={wrong ? t("forms.list") : error} {...(wrong || !errorProps ? {} : { errorProps })} rightSection={unit ? <span style={{ fontSize: "0.75rem", whiteSpace: "nowrap" }}>{prettyUnit(unit)}</span> : undefined} rightSectionWidth={unit ? 44 : undefined} rightSectionPointerEvents="none" classNames={{ input: "numbers" }} spellCheck={false} autoComplete="off" />;
}
