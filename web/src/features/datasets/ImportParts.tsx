import { Checkbox, Fieldset, NativeSelect, NumberInput, Stack } from "@mantine/core";
import { Controller, useFormContext, useWatch } from "react-hook-form";
import { useTranslation } from "react-i18next";
import { formatNumber } from "@/shared/units/format";
import { groupsOf, withGroup, type ImportFields, type Look } from "./importing";

/** The groups of a file, each with its own time: a group that is taken becomes a recording. */
export function GroupBoxes({ look }: { look: Look }) {
  const { t } = useTranslation();
  const { setValue, control } = useFormContext<ImportFields>();
  const columns = useWatch({ control, name: "columns" });
  const groups = groupsOf(look, columns);
  if (groups.length < 2) return null;
  return (
    <Fieldset legend={t("importing.groups")} data-testid="import-groups">
      <Stack gap="xs">
        {groups.map(({ name, channels, taken, sample_rate, sample_count }) => (
          <Checkbox
            key={name}
            size="xs"
            label={name}
            description={[t("importing.taken", { taken, count: channels }), ...(sample_count === null ? [] : [t("importing.samples", { count: sample_count })]), sample_rate === null ? t("importing.ownInstants") : t("importing.perSecond", { rate: formatNumber(sample_rate) })].join(", ")}
            checked={taken > 0}
            indeterminate={taken > 0 && taken < channels}
            onChange={(event) => setValue("columns", withGroup(columns, name, event.currentTarget.checked), { shouldDirty: true, shouldValidate: true })}
          />
        ))}
      </Stack>
    </Fieldset>
  );
}

/** What becomes of instants that lie on no even axis. */
export function UnevenFields({ wrong }: { wrong(key: "uneven_rate" | "uneven_method", pointer: string): string | undefined }) {
  const { t } = useTranslation();
  const { control, register } = useFormContext<ImportFields>();
  const [time, uneven] = useWatch({ control, name: ["time", "uneven"] });
  if (time === "") return null;
  return (
    <>
      <NativeSelect size="xs" label={t("importing.uneven")} {...register("uneven")} data={(["keep", "resample"] as const).map((value) => ({ value, label: t(`importing.unevenKinds.${value}`) }))} />
      {uneven === "resample" && (
        <>
          <Controller
            control={control}
            name="uneven_rate"
            render={({ field }) => <NumberInput size="xs" w={150} label={t("importing.unevenRate")} hideControls suffix=" 1/s" value={field.value ?? ""} onChange={(value) => field.onChange(value === "" ? undefined : Number(value))} error={wrong("uneven_rate", "/import/uneven/resample/rate")} />}
          />
          <NativeSelect size="xs" label={t("importing.unevenMethod")} {...register("uneven_method")} data={(["linear", "cubic"] as const).map((value) => ({ value, label: t(`importing.unevenMethods.${value}`) }))} error={wrong("uneven_method", "/import/uneven/resample/method")} />
        </>
      )}
    </>
  );
}
