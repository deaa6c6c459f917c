import { Group, NativeSelect, Text, TextInput } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { ListEntry } from "@/shared/forms/SchemaFields";
import { toldElsewhere } from "@/shared/forms/faults";
import { NumberEntry } from "@/shared/ui/NumberEntry";
import { withUnit } from "@/shared/units/format";
import { changed, without, type Part } from "./form";
import { LINE, RowTable } from "./RowTable";
import { CHOSEN, type Variable } from "./schema";

const FIELDS = ["parameter", "lower", "upper", "choices", "expression", "start", "scale"] as const;

/** Design variables and their ranges. */
export function Variables({ form, opened, change, faultAt }: Part) {
  const { t } = useTranslation();
  const free = opened.parameters.filter((p) => !p.bound);
  const known = new Map(opened.parameters.map((p) => [p.path, p]));
  const unitOf = ({ parameter }: Variable) => known.get(parameter)?.unit ?? "";
  const now = (row: Variable) => (known.has(row.parameter) ? withUnit(known.get(row.parameter)!.value, unitOf(row)) : "");
  const wrong = (i: number, field: (typeof FIELDS)[number]) => toldElsewhere(faultAt(`variables.${i}.${field}`));
  const put = (i: number, part: Partial<Variable>) => change({ variables: changed(form.variables, i, part) });
  const next = free.find((p) => !form.variables.some((row) => row.parameter === p.path));
  const outOf = (row: Variable, i: number) => {
    const { parameter: name, chosen } = row;
    const bound = (key: "lower" | "upper", label: string) => <NumberEntry aria-label={t(label, { name })} value={row[key]} unit={unitOf(row)} {...wrong(i, key)} optional placeholder={t("optimise.asDocument")} onCommit={(value) => put(i, { [key]: value })} w={unitOf(row).length > 4 ? 132 : 108} />;
    if (chosen === "list") return <ListEntry label="" aria-label={t("optimise.choicesOf", { name })} value={row.choices} unit={unitOf(row)} placeholder="10; 12; 15" {...wrong(i, "choices")} onChange={(choices) => put(i, { choices })} />;
    if (chosen === "tied") return <TextInput size="xs" aria-label={t("optimise.expressionOf", { name })} value={row.expression ?? ""} placeholder="=kp/20" spellCheck={false} {...wrong(i, "expression")} onChange={(event) => put(i, { expression: event.currentTarget.value })} />;
    return (
      <Group gap={6} wrap="nowrap" align="flex-start">
        {bound("lower", "optimise.from")}
        <Text fz="sm" lh={LINE}>
          …
        </Text>
        {bound("upper", "optimise.to")}
      </Group>
    );
  };
  const besides = (row: Variable, i: number) => (
    <Group gap="sm" align="flex-end" pl="md">
      <NumberEntry label={t("optimise.begin")} aria-label={t("optimise.beginOf", { name: row.parameter })} value={row.start} unit={unitOf(row)} optional placeholder={t("optimise.asDocument")} {...wrong(i, "start")} onCommit={(start) => put(i, { start })} w={170} />
      {row.chosen !== "list" && (
        <NativeSelect
          size="xs"
          label={t("optimise.scale")}
          aria-label={t("optimise.scaleOf", { name: row.parameter })}
          value={row.scale ?? ""}
          data={[{ value: "", label: t("optimise.asDocument") }, ...(["linear", "log"] as const).map((value) => ({ value, label: t(`optimise.scales.${value}`) }))]}
          {...wrong(i, "scale")}
          onChange={(event) => put(i, { scale: (event.currentTarget.value || undefined) as Variable["scale"] })}
        />
      )}
    </Group>
  );
  return (
    <RowTable
      testId="variables"
      title={t("optimise.variables")}
      doc={t("optimise.variablesDoc")}
      field="variables"
      fields={FIELDS}
      faultAt={faultAt}
      minWidth={620}
      maxWidth={980}
      heads={[{ title: t("optimise.parameter") }, { title: t("optimise.now"), numeric: true }, { title: t("optimise.chosen") }, { title: t("optimise.outOf") }]}
      rows={form.variables}
      cells={(row, i) => [
        <NativeSelect size="xs" aria-label={t("optimise.variable", { number: i + 1 })} title={row.parameter} value={row.parameter} data={free.map((p) => p.path)} {...wrong(i, "parameter")} onChange={(event) => put(i, { parameter: event.currentTarget.value })} />,
        now(row),
        <NativeSelect size="xs" aria-label={t("optimise.chosenOf", { name: row.parameter })} value={row.chosen} data={CHOSEN.map((value) => ({ value, label: t(`optimise.chosenAs.${value}`) }))} onChange={(event) => put(i, { chosen: event.currentTarget.value as Variable["chosen"] })} />,
        outOf(row, i),
      ]}
      more={(row, i) => (row.chosen === "tied" ? null : { label: t("optimise.moreOf", { name: row.parameter }), said: row.start !== undefined || row.scale !== undefined, content: besides(row, i) })}
      dropLabel={(row) => t("optimise.drop", { name: row.parameter })}
      onDrop={(i) => change({ variables: without(form.variables, i) })}
      add={{ label: t("optimise.addVariable"), disabled: form.variables.length >= free.length, onClick: () => next && change({ variables: [...form.variables, { parameter: next.path, chosen: "range" }] }) }}
    />
  );
}
