import { Group, List, MultiSelect, NativeSelect, Stack, Text, TextInput, Title } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { ListEntry } from "@/shared/forms/SchemaFields";
import { PlainEntry } from "@/shared/ui/PlainEntry";
import { words } from "@/shared/units/format";
import { adviceOf } from "./advice";
import type { Part } from "./form";
import type { Search } from "./schema";

/** The method with its options from the catalogue, and what can be said of that choice before it runs. */
export function Method({ form, metrics, methods, change, faultAt }: Part) {
  const { t } = useTranslation();
  const method = methods.find(({ kind }) => kind === form.method);
  /** One that is not said is left to the method. */
  const option = (name: string, value: number | string | number[] | undefined) => change({ options: Object.fromEntries(Object.entries({ ...form.options, [name]: value }).flatMap(([key, own]) => (own === undefined ? [] : [[key, own]]))) });
  const sentences = adviceOf(form, method, metrics);
  return (
    <section data-testid="method">
      <Title order={2} mb="xs">
        {t("optimise.search")}
      </Title>
      <Stack gap={6} maw={980}>
        <Group gap="sm" align="flex-start">
          <NativeSelect size="xs" label={t("optimise.method")} value={form.method} data={methods.map((m) => ({ value: m.kind, label: m.title }))} error={faultAt("method")} onChange={(event) => change({ method: event.currentTarget.value, options: {}, others: form.others.filter((kind) => kind !== event.currentTarget.value) })} />
          {method?.parameters.map((p) => {
            const { choices } = p as { choices?: string[] };
            const common = { label: words(p.name), title: p.doc, error: faultAt(`options.${p.name}`) };
            const value = form.options[p.name];
            if (choices) return <NativeSelect key={p.name} size="xs" {...common} value={String(value ?? p.default)} data={choices.map((one) => ({ value: one, label: words(one) }))} onChange={(event) => option(p.name, event.currentTarget.value === p.default ? undefined : event.currentTarget.value)} />;
            // Points of a grid are one number, or one for each parameter.
            if (form.method === "grid" && p.name === "points") return <ListEntry key={p.name} {...common} value={value} unit="" placeholder={String(p.default ?? "")} w={110} onChange={(list) => option(p.name, list.length === 0 ? undefined : list.length === 1 ? Number(list[0]) : list.map(Number))} />;
            return <PlainEntry key={p.name} {...common} value={value as number | undefined} placeholder={String(p.default ?? "")} optional w={130} onCommit={(next) => option(p.name, next)} />;
          })}
        </Group>
        <Text fz="xs" c="dimmed">
          {method?.doc}
        </Text>
        {sentences.length > 0 && (
          <List size="sm" data-testid="advice">
            {sentences.map(({ key, values }) => (
              <List.Item key={key}>{t(key, values ?? {})}</List.Item>
            ))}
          </List>
        )}
        <Group gap="sm" align="flex-start">
          <MultiSelect label={t("optimise.others")} description={t("optimise.othersDoc")} data={methods.filter(({ kind }) => kind !== form.method && kind !== "auto").map((m) => ({ value: m.kind, label: m.title }))} value={form.others} error={faultAt("others")} onChange={(others) => change({ others })} maxValues={5} w={340} />
          <NativeSelect size="xs" label={t("optimise.priority")} description={t("optimise.priorityDoc")} value={form.priority} data={(["high", "normal", "low"] as const).map((value) => ({ value, label: t(`optimise.priorities.${value}`) }))} error={faultAt("priority")} onChange={(event) => change({ priority: event.currentTarget.value as Search["priority"] })} />
          <PlainEntry label={t("optimise.limit")} description={t("optimise.limitDoc")} value={form.limit} unit="s" optional error={faultAt("limit")} onCommit={(limit) => change({ limit })} w={200} />
          <TextInput size="xs" type="datetime-local" label={t("optimise.deadline")} description={t("optimise.deadlineDoc")} value={form.deadline === undefined ? "" : localOf(form.deadline)} error={faultAt("deadline")} onChange={(event) => change({ deadline: event.currentTarget.value === "" ? undefined : new Date(event.currentTarget.value).toISOString() })} w={220} />
        </Group>
      </Stack>
    </section>
  );
}

/** An instant as the field shows it: to the minute, where the reader is. */
function localOf(instant: string): string {
  const at = new Date(instant);
  return new Date(at.getTime() - 60_000 * at.getTimezoneOffset()).toISOString().slice(0, 16);
}
