import { Button, Group, MultiSelect, NativeSelect, Stack, Table, Text, Textarea, Title } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useTranslation } from "react-i18next";
import { api, must } from "@/shared/api/client";
import { toldElsewhere } from "@/shared/forms/faults";
import { NumberEntry } from "@/shared/ui/NumberEntry";
import { PlainEntry } from "@/shared/ui/PlainEntry";
import { changed, without, type Part } from "./form";
import { Drop, RowFaults } from "./parts";
import type { Search } from "./schema";

type Uncertain = Search["uncertain"][number];

/** Scenarios, uncertain ranges and other structures that one choice must serve. */
export function Robustness({ form, opened, change, faultAt, system }: Part & { system: string }) {
  const { t } = useTranslation();
  const free = opened.parameters.filter((p) => !p.bound && !form.variables.some((row) => row.parameter === p.path));
  const units = new Map(opened.parameters.map((p) => [p.path, p.unit]));
  const systems = useQuery({ queryKey: ["search", "systems"], queryFn: () => must(api.GET("/v1/systems", { params: { query: { limit: 200 } } })) });
  const names = new Map((systems.data?.items ?? []).map(({ id, name }) => [id, name || id]));
  for (const { id, name } of form.structures) if (id !== "" && !names.has(id)) names.set(id, name || id);
  names.delete(system);
  const put = (i: number, part: Partial<Uncertain>) => change({ uncertain: changed(form.uncertain, i, part) });
  const addUncertain = () => {
    const next = free.find(({ path }) => !form.uncertain.some((row) => row.parameter === path));
    if (!next) return;
    const [a, b] = [0.8, 1.2].map((factor) => Number((factor * next.value).toPrecision(4)));
    change({ uncertain: [...form.uncertain, { parameter: next.path, ...(next.value === 0 ? {} : { lower: Math.min(a!, b!), upper: Math.max(a!, b!) }) }] });
  };
  return (
    <section data-testid="robustness">
      <Title order={2}>{t("optimise.serves")}</Title>
      <Text fz="sm" c="dimmed" mb="xs">
        {t("optimise.servesDoc")}
      </Text>
      <Group align="flex-start" gap="xl">
        <Textarea label={t("optimise.scenarios")} description={t("optimise.scenariosDoc")} placeholder="motor.mass = 2000; motor.leakage = 45 cm**5/(daN*s)" autosize minRows={2} w={420} value={form.scenarios} onChange={(event) => change({ scenarios: event.currentTarget.value })} error={faultAt("scenarios")} />
        <NativeSelect
          size="xs"
          label={t("optimise.across")}
          description={t("optimise.acrossDoc")}
          value={form.across}
          data={[
            { value: "worst", label: t("optimise.worst") },
            { value: "mean", label: t("optimise.mean") },
          ]}
          error={faultAt("across")}
          onChange={(event) => change({ across: event.currentTarget.value as Search["across"] })}
        />
        <MultiSelect label={t("optimise.structures")} description={t("optimise.structuresDoc")} placeholder={form.structures.length === 0 ? t("optimise.structuresNone") : ""} searchable data={[...names].map(([value, label]) => ({ value, label: `${label} (${value.slice(-6)})` }))} value={form.structures.flatMap(({ id }) => id || [])} error={faultAt("structures")} onChange={(ids) => change({ structures: [...ids.map((id) => ({ id, name: ids.some((other) => other !== id && names.get(other) === names.get(id)) ? id : (names.get(id) ?? id) })), ...form.structures.filter(({ id }) => id === "")] })} w={340} />
      </Group>
      <Stack gap={4} mt="sm" align="flex-start">
        {form.uncertain.length > 0 && (
          <Table maw={760} verticalSpacing={4}>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>{t("optimise.uncertain")}</Table.Th>
                <Table.Th>{t("optimise.anywhere")}</Table.Th>
                <Table.Th aria-label={t("systems.actions")} />
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {form.uncertain.map((row, i) => (
                <Table.Tr key={i}>
                  <Table.Td>
                    <NativeSelect size="xs" aria-label={t("optimise.uncertainNumber", { number: i + 1 })} value={row.parameter} data={[row.parameter, ...free.map(({ path }) => path).filter((path) => path !== row.parameter)]} {...toldElsewhere(faultAt(`uncertain.${i}.parameter`))} onChange={(event) => put(i, { parameter: event.currentTarget.value, lower: undefined, upper: undefined })} />
                    <RowFaults row={`uncertain.${i}`} fields={["parameter", "lower", "upper"]} faultAt={faultAt} />
                  </Table.Td>
                  <Table.Td>
                    <Group gap={6} wrap="nowrap">
                      <NumberEntry aria-label={t("optimise.uncertainFrom", { name: row.parameter })} value={row.lower} unit={units.get(row.parameter)} optional {...toldElsewhere(faultAt(`uncertain.${i}.lower`))} onCommit={(lower) => put(i, { lower })} />
                      <Text fz="sm">…</Text>
                      <NumberEntry aria-label={t("optimise.uncertainTo", { name: row.parameter })} value={row.upper} unit={units.get(row.parameter)} optional {...toldElsewhere(faultAt(`uncertain.${i}.upper`))} onCommit={(upper) => put(i, { upper })} />
                    </Group>
                  </Table.Td>
                  <Table.Td w={40}>
                    <Drop label={t("optimise.dropUncertain", { name: row.parameter })} onClick={() => change({ uncertain: without(form.uncertain, i) })} />
                  </Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        )}
        <Group align="flex-end">
          <Button variant="default" onClick={addUncertain} disabled={free.length === 0}>
            {t("optimise.addUncertain")}
          </Button>
          {form.uncertain.length > 0 && <PlainEntry label={t("optimise.draws")} title={t("optimise.drawsDoc")} value={form.draws} optional placeholder="0" error={faultAt("draws")} onCommit={(draws) => change({ draws })} w={130} />}
        </Group>
      </Stack>
    </section>
  );
}
