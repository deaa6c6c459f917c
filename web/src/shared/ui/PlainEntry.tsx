import type { ComponentProps } from "react";
import { useTranslation } from "react-i18next";
import type { Scalar } from "@/shared/api/types";
import { inUnit } from "@/shared/units/convert";
import { prettyUnit } from "@/shared/units/format";
import { NumberEntry, shownScalar } from "./NumberEntry";

interface Props extends Omit<ComponentProps<typeof NumberEntry>, "onCommit" | "refuse" | "expressions"> {
  onCommit(value: number | undefined): void;
  /** Why a number is not taken, if so. */
  refuse?(value: number): string | undefined;
}

/** A number kept in one unit: what is typed in another one is converted, or refused with the unit that is meant. */
export function PlainEntry({ unit = "", onCommit, refuse, ...rest }: Props) {
  const { t } = useTranslation();
  const plain = (value: Scalar): number | null => (typeof value === "number" ? value : typeof value === "object" ? inUnit(value.value, value.unit, unit) : null);
  return (
    <NumberEntry
      {...rest}
      unit={unit}
      refuse={(value) => {
        const number = plain(value);
        if (number !== null) return refuse?.(number);
        const entry = shownScalar(value);
        return unit === "" || unit === "1" ? t("number.plain", { entry }) : t("number.unit", { unit: prettyUnit(unit), entry });
      }}
      onCommit={(value) => onCommit(value === undefined ? undefined : (plain(value) ?? undefined))}
    />
  );
}
