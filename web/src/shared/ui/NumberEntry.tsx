import { TextInput, type TextInputProps } from "@mantine/core";
import { useEffect, useState } from "react";
import { useTranslation } from "react-i18next";
import type { Scalar } from "@/shared/api/types";
import { prettyUnit, withUnit } from "@/shared/units/format";
import { readEntry } from "@/shared/units/number";
import { useDraft } from "./useDraft";

const quantityText = ({ value, unit }: { value?: unknown; unit: unknown }) => `${String(value)} ${String(unit)}`;

export function shownScalar(value: unknown): string {
  if (value === undefined || value === null) return "";
  if (typeof value === "object" && "unit" in value) return quantityText(value as { value?: unknown; unit: unknown });
  return String(value);
}

interface Props extends Omit<TextInputProps, "value" | "onChange"> {
  value: Scalar | undefined;
  unit?: string;
  onCommit(value: Scalar | undefined): void;
  expressions?: boolean;
  optional?: boolean;
  /** Why a number that can be read is not taken, if so. */
  refuse?(value: Scalar): string | undefined;
}

/** A number with its unit, read when the entry is left or Enter is pressed: `2.4k`, `330 m`, `65 cm**2`, `=kp/20`. */
export function NumberEntry({ value, unit = "", onCommit, expressions = false, optional = false, refuse, error, ...rest }: Props) {
  const { t } = useTranslation();
  const given = shownScalar(value);
  const { text, type, take, giveUp } = useDraft(given);
  const [wrong, setWrong] = useState<string | null>(null);
  useEffect(() => setWrong(null), [given]);
  const read = readEntry(text, unit);
  const commit = () => {
    if (!take()) return;
    if (text === given) return setWrong(null);
    if (optional && text.trim() === "") return onCommit(undefined);
    if (read.kind === "wrong" && read.either) return setWrong(t("number.ambiguous", { entry: text.trim(), ...read.either }));
    if (read.kind === "wrong" || (read.kind === "expression" && !expressions)) return setWrong(t("number.wrong"));
    const found = read.kind === "number" ? read.value : read.kind === "quantity" ? { value: read.value, unit: read.unit } : read.text;
    const refused = refuse?.(found) ?? null;
    setWrong(refused);
    if (refused !== null) return;
    onCommit(found);
    // What is kept is what is shown: a value that is clamped to what it was would else leave the typed one standing.
    giveUp();
  };
  // A value that is kept with a unit of its own shows that one: `80 Hz` is not in rad/s.
  const suffix = unit === "1" || (typeof value === "object" && value !== null) || read.kind === "quantity" ? "" : prettyUnit(unit);
  // What a prefix or comma was understood as is told before it counts.
  const understood = text !== given && read.kind === "number" && String(read.value) !== text.trim() ? `= ${withUnit(read.value, unit)}` : undefined;
  return (
    <TextInput
      {...rest}
      value={text}
      error={wrong ?? error}
      {...(wrong === null ? {} : { errorProps: {} })}
      description={rest.description ?? understood}
      onChange={(event) => type(event.currentTarget.value)}
      onBlur={commit}
      onKeyDown={(event) => {
        if (event.key === "Enter") {
          // In a form it takes the number over, and does not yet send everything.
          event.preventDefault();
          commit();
        }
        if (event.key === "Escape") {
          giveUp();
          setWrong(null);
        }
      }}
      rightSection={suffix ? <span style={{ fontSize: "0.75rem", paddingRight: 8, whiteSpace: "nowrap" }}>{suffix}</span> : undefined}
      rightSectionWidth={suffix ? Math.max(28, suffix.length * 7 + 12) : undefined}
      rightSectionPointerEvents="none"
      classNames={{ input: "numbers" }}
      inputMode="text"
      spellCheck={false}
      autoComplete="off"
    />
  );
}
