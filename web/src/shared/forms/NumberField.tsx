import { NumberInput } from "@mantine/core";
import { Controller, type Control, type FieldPath, type FieldValues } from "react-hook-form";

interface Props<Fields extends FieldValues> {
  control: Control<Fields>;
  name: FieldPath<Fields>;
  label?: string;
  "aria-label"?: string;
  description?: string;
  /** Behind the number: `s`, `%`. */
  unit?: string;
  error?: string | undefined;
  w?: number;
  /** Empty means that nothing is said; otherwise it is no number, which the form refuses. */
  optional?: boolean;
  /** What the form keeps for what is shown: 0.01 keeps shares and shows per cent. */
  factor?: number;
}

/** A plain number of a form. */
export function NumberField<Fields extends FieldValues>({ control, name, unit, optional = false, factor = 1, ...rest }: Props<Fields>) {
  return (
    <Controller
      control={control}
      name={name}
      render={({ field }) => {
        const value = field.value as number | undefined;
        const shown = value === undefined || Number.isNaN(value) ? "" : factor === 1 ? value : Math.round((value / factor) * 1e6) / 1e6;
        return <NumberInput size="xs" hideControls {...rest} {...(unit ? { suffix: ` ${unit}` } : {})} value={shown} onChange={(next) => field.onChange(next === "" ? (optional ? undefined : NaN) : Number(next) * factor)} onBlur={field.onBlur} classNames={{ input: "numbers" }} />;
      }}
    />
  );
}
