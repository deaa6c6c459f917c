import { Group, NativeSelect } from "@mantine/core";
import type { UseFormReturn } from "react-hook-form";
import { useTranslation } from "react-i18next";
import type { Problem } from "@/shared/api/problem";
import { faultAt } from "@/shared/forms/faults";
import { NumberField } from "@/shared/forms/NumberField";
import { prettyUnit } from "@/shared/units/format";
import type { RigInput } from "./api";
import { schema, triggerOf, type Fields } from "./request";

/** What a recording without a drive waits for. */
export function TriggerFields({ form, inputs, problem }: { form: UseFormReturn<Fields>; inputs: RigInput[]; problem: Problem | null }) {
  const { t } = useTranslation();
  const { control, register, watch } = form;
  const values = watch();
  const { waits, window } = triggerOf(values);
  const channel = values.channels.includes(values.trigger_channel) ? values.trigger_channel : values.channels[0];
  const unit = prettyUnit(inputs.find((input) => input.name === channel)?.unit ?? "");
  const wrong = (field: keyof Fields, ...places: string[]) => faultAt(t, form, null, field) ?? places.map((place) => problem?.at(`/trigger${place}`)).find((detail) => detail !== undefined);
  return (
    <Group grow preventGrowOverflow={false} align="flex-start">
      <NativeSelect size="xs" label={t("rigs.trigger")} {...register("trigger")} error={wrong("trigger")} data={schema.shape.trigger.options.map((kind) => ({ value: kind, label: t(`rigs.triggers.${kind}`) }))} />
      {waits && <NativeSelect size="xs" label={t("rigs.triggerChannel")} {...register("trigger_channel")} value={channel ?? ""} error={wrong("trigger_channel", "/channel")} data={values.channels} />}
      {waits && <NumberField control={control} name="level" label={t(window ? "rigs.windowLow" : "rigs.level")} unit={unit} error={wrong("level", "/level", "/window")} />}
      {window && <NumberField control={control} name="high" label={t("rigs.windowHigh")} unit={unit} error={wrong("high")} />}
      {waits && <NumberField control={control} name="hysteresis" label={t("rigs.hysteresis")} unit={unit} error={wrong("hysteresis", "/hysteresis")} />}
      {waits && <NumberField control={control} name="timeout" label={t("rigs.waitsAtMost")} unit="s" error={wrong("timeout", "/timeout")} />}
    </Group>
  );
}
