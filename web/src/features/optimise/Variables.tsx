import { Button, Group, NativeSelect, Table, Text, TextInput, Title } from "@mantine/core";
import { Fragment, useState } from "react";
import { useTranslation } from "react-i18next";
import { ListEntry } from "@/shared/forms/SchemaFields";
import { NumberEntry } from "@/shared/ui/NumberEntry";
import { withUnit } from "@/shared/units/format";
import { changed, without, type Part } from "./form";
import { Drop, More, RowFaults } from "./parts";
import { CHOSEN, type Variable } from "./schema";

const FIELDS = ["parameter", "lower", "upper", "choices", "expression", "start", "scale"] as const;

/** What may be chosen, and out of what. */
export function Variables({ form, opened, change, faultAt }: Part) {
  const { t } = useTranslation();
  const [open, setOpen] = useState<ReadonlySet<number>>(new Set());
  const free = opened.parameters.filter((p) => !p.bound);
  const known = new Map(opened.parameters.map((p) => [p.path, p]));
  const put = (i: number, part: Partial<Variable>) => change({ variables: changed(form.variables, i, part) });
  const toggle = (i: number) => setOpen((before) => new Set(before.has(i) ? [...before].filter((k) => k !== i) : [...before, i]));
  const now = (name: string) => (known.has(name) ? withUnit(known.get(name)!.value, known.get(name)!.unit) : "");
  return (
    <section data-testid="variables">
      <Title order={2}>{t("optimise.variables")}</Title>
      <Text fz="sm" c="dimmed" mb="xs">
        {t("optimise.variablesDoc")}
      </Text>
      {form.variables.length > 0 && (
        <Table.ScrollContainer minWidth={680}>
          <Table maw={980} verticalSpacing={4}>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>{t("optimise.parameter")}</Table.Th>
                <Table.Th ta="right">{t("optimise.now")}</Table.Th>
                <Table.Th>{t("optimise.chosen")}</Table.Th>
                <Table.Th>{t("optimise.outOf")}</Table.Th>
                <Table.Th aria-label={t("systems.actions")} />
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {form.variables.map((row, i) => {
                const unit = known.get(row.parameter)?.unit ?? "";
                const bounded = row.chosen === "range" || row.chosen === "whole";
                const wide = row.chosen !== "tied" && (open.has(i) || row.start !== undefined || row.scale !== undefined);
                return (
                  <Fragment key={i}>
                    <Table.Tr>
                      <Table.Td>
                        <NativeSelect size="xs" aria-label={t("optimise.variable", { number: i + 1 })} value={row.parameter} data={free.map((p) => p.path)} onChange={(event) => put(i, { parameter: event.currentTarget.value })} />
                        <RowFaults row={`variables.${i}`} fields={FIELDS} faultAt={faultAt} />
                      </Table.Td>
                      <Table.Td ta="right" className="numbers">
                        {now(row.parameter)}
                      </Table.Td>
                      <Table.Td>
                        <NativeSelect size="xs" aria-label={t("optimise.chosenOf", { name: row.parameter })} value={row.chosen} data={CHOSEN.map((value) => ({ value, label: t(`optimise.chosenAs.${value}`) }))} onChange={(event) => put(i, { chosen: event.currentTarget.value as Variable["chosen"] })} />
                      </Table.Td>
                      <Table.Td>
                        {bounded && (
                          <Group gap={6} wrap="nowrap">
                            <NumberEntry aria-label={t("optimise.from", { name: row.parameter })} value={row.lower} unit={unit} error={faultAt(`variables.${i}.lower`) !== undefined} optional placeholder={t("optimise.asDocument")} onCommit={(lower) => put(i, { lower })} />
                            <Text fz="sm">…</Text>
                            <NumberEntry aria-label={t("optimise.to", { name: row.parameter })} value={row.upper} unit={unit} error={faultAt(`variables.${i}.upper`) !== undefined} optional placeholder={t("optimise.asDocument")} onCommit={(upper) => put(i, { upper })} />
                          </Group>
                        )}
                        {row.chosen === "list" && <ListEntry label="" aria-label={t("optimise.choicesOf", { name: row.parameter })} value={row.choices} unit={unit} placeholder="10; 12; 15" onChange={(choices) => put(i, { choices })} />}
                        {row.chosen === "tied" && <TextInput size="xs" aria-label={t("optimise.expressionOf", { name: row.parameter })} value={row.expression ?? ""} placeholder="=kp/20" spellCheck={false} error={faultAt(`variables.${i}.expression`) !== undefined} onChange={(event) => put(i, { expression: event.currentTarget.value })} />}
                      </Table.Td>
                      <Table.Td w={76}>
                        <Group gap={0} wrap="nowrap" justify="flex-end">
                          {row.chosen !== "tied" && <More label={t("optimise.moreOf", { name: row.parameter })} open={wide} onClick={() => toggle(i)} />}
                          <Drop label={t("optimise.drop", { name: row.parameter })} onClick={() => change({ variables: without(form.variables, i) })} />
                        </Group>
                      </Table.Td>
                    </Table.Tr>
                    {wide && (
                      <Table.Tr>
                        <Table.Td colSpan={5} pt={0}>
                          <Group gap="sm" align="flex-end" pl="md">
                            <NumberEntry label={t("optimise.begin")} aria-label={t("optimise.beginOf", { name: row.parameter })} value={row.start} unit={unit} optional placeholder={t("optimise.asDocument")} onCommit={(start) => put(i, { start })} w={170} />
                            {row.chosen !== "list" && (
                              <NativeSelect
                                size="xs"
                                label={t("optimise.scale")}
                                aria-label={t("optimise.scaleOf", { name: row.parameter })}
                                value={row.scale ?? ""}
                                data={[{ value: "", label: t("optimise.asDocument") }, ...(["linear", "log"] as const).map((value) => ({ value, label: t(`optimise.scales.${value}`) }))]}
                                onChange={(event) => put(i, { scale: (event.currentTarget.value || undefined) as Variable["scale"] })}
                              />
                            )}
                          </Group>
                        </Table.Td>
                      </Table.Tr>
                    )}
                  </Fragment>
                );
              })}
            </Table.Tbody>
          </Table>
        </Table.ScrollContainer>
      )}
      {faultAt("variables") && (
        <Text fz="xs" c="var(--mantine-color-error)" role="alert">
          {faultAt("variables")}
        </Text>
      )}
      <Button
        variant="default"
        mt="xs"
        disabled={form.variables.length >= free.length}
        onClick={() => {
          const next = free.find((p) => !form.variables.some((row) => row.parameter === p.path));
          if (next) change({ variables: [...form.variables, { parameter: next.path, chosen: "range" }] });
        }}
      >
        {t("optimise.addVariable")}
      </Button>
    </section>
  );
}
