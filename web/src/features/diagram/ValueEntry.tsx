import { NativeSelect, TextInput } from "@mantine/core";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import type { ParameterEntry, Scalar } from "@/shared/api/types";
import { NumberEntry } from "@/shared/ui/NumberEntry";
import { useDraft } from "@/shared/ui/useDraft";

interface Props {
  "data-parameter"?: boolean;
  parameter: ParameterEntry & { shape?: string; required?: boolean; default?: unknown };
  value: unknown;
  error: string | undefined;
  onCommit(value: unknown): void;
}

/** One parameter of a block, entered as its shape wants: a number with its unit, a choice, a list, a matrix. */
export function ValueEntry({ parameter, value, error, onCommit, ...rest }: Props) {
  const { shape, name, unit, doc } = parameter;
  const label = `${name}${parameter.required ? " *" : ""}`;
  const fallback = parameter.default ?? undefined;
  if (parameter.choices?.length) {
    return <NativeSelect wrapperProps={rest} size="xs" label={label} description={doc} value={String(value ?? fallback ?? "")} error={error} data={parameter.required ? parameter.choices : ["", ...parameter.choices.filter((c) => c !== "")]} onChange={(event) => onCommit(event.currentTarget.value || undefined)} />;
  }
  if (shape === undefined || shape === "scalar" || shape === "integer") {
    return <NumberEntry wrapperProps={rest} label={label} title={doc} value={value as Scalar | undefined} unit={unit} expressions optional error={error} placeholder={fallback === undefined || fallback === null ? undefined : String(fallback as string | number)} onCommit={onCommit} />;
  }
  return <ListEntry wrapperProps={rest} label={label} doc={doc} value={value} text={shape === "text"} error={error} onCommit={onCommit} />;
}

function ListEntry({ wrapperProps, label, doc, value, text: plain, error, onCommit }: { wrapperProps: Record<`data-${string}`, boolean | undefined>; label: string; doc: string; value: unknown; text: boolean; error: string | undefined; onCommit(value: unknown): void }) {
  const { t } = useTranslation();
  const given = value === undefined ? "" : plain ? String(value) : JSON.stringify(value);
  const { text, type, take } = useDraft(given);
  const [wrong, setWrong] = useState(false);
  const commit = () => {
    if (!take()) return;
    if (text === given) return setWrong(false);
    if (text.trim() === "") return onCommit(undefined);
    if (plain) return onCommit(text.trim());
    const read = readList(text);
    setWrong(read === undefined);
    if (read !== undefined) onCommit(read);
  };
  return <TextInput wrapperProps={wrapperProps} label={label} title={doc} value={text} onChange={(event) => type(event.currentTarget.value)} onBlur={commit} onKeyDown={(event) => event.key === "Enter" && commit()} error={wrong ? t("diagram.noList") : error} spellCheck={false} classNames={{ input: "numbers" }} />;
}

/** `[1, 2]` as JSON, or just `1, 2`. */
export function readList(text: string): unknown[] | undefined {
  for (const attempt of [text, `[${text}]`]) {
    try {
      const found: unknown = JSON.parse(attempt);
      if (Array.isArray(found)) return found;
    } catch {
      continue;
    }
  }
  return undefined;
}
