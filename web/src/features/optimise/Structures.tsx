import { Button, Group, MultiSelect, Paper, Stack, Text, Textarea, TextInput, Title } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useTranslation } from "react-i18next";
import { systemQuery } from "@/shared/api/systems";
import { changed, without, type Part } from "./form";
import { Drop } from "./parts";
import type { Structure } from "./schema";
import { partsOf } from "./structures";

/** Structures that differ from this system by some parts: what each does without, what it has besides, what is chosen in it. */
export function Structures({ form, change, faultAt, system }: Part & { system: string }) {
  const { t } = useTranslation();
  const document = useQuery(systemQuery(system)).data?.document;
  const parts = document ? partsOf(document) : { blocks: [], connections: [] };
  const put = (i: number, part: Partial<Structure>) => change({ structures: changed(form.structures, i, part) });
  const add = () => {
    const taken = new Set(form.structures.map(({ name }) => name));
    let number = 2;
    while (taken.has(`structure ${number}`)) number++;
    change({ structures: [...form.structures, { id: "", name: `structure ${number}` }] });
  };
  return (
    <section data-testid="structures">
      <Title order={2}>{t("optimise.parts")}</Title>
      <Text fz="sm" c="dimmed" mb="xs">
        {t("optimise.partsDoc")}
      </Text>
      <Stack gap="xs">
        {form.structures.map((structure, i) =>
          structure.id !== "" ? null : (
            <Paper key={i} withBorder p="xs" maw={1180}>
              <Group align="flex-start" gap="sm" wrap="nowrap" justify="space-between">
                <Group align="flex-start" gap="sm">
                  <TextInput size="xs" label={t("optimise.partsName")} value={structure.name} error={faultAt(`structures.${i}.name`)} onChange={(event) => put(i, { name: event.currentTarget.value })} w={170} />
                  <MultiSelect
                    label={t("optimise.removed")}
                    aria-label={t("optimise.removedOf", { name: structure.name })}
                    data={[
                      { group: t("diagram.palette"), items: parts.blocks },
                      { group: t("diagram.signals"), items: parts.connections },
                    ]}
                    value={structure.removed ?? []}
                    error={faultAt(`structures.${i}.removed`)}
                    onChange={(removed) => put(i, { removed: removed.length > 0 ? removed : undefined })}
                    searchable
                    w={280}
                  />
                  <Textarea size="xs" label={t("optimise.added")} aria-label={t("optimise.addedOf", { name: structure.name })} description={t("optimise.addedDoc")} placeholder={EXAMPLE} autosize minRows={2} maxRows={10} value={structure.added ?? ""} error={faultAt(`structures.${i}.added`)} onChange={(event) => put(i, { added: event.currentTarget.value || undefined })} w={380} />
                  <TextInput size="xs" label={t("optimise.ranges")} aria-label={t("optimise.rangesOf", { name: structure.name })} description={t("optimise.rangesDoc")} placeholder="lead.zero = 1 ... 100" value={structure.ranges ?? ""} error={faultAt(`structures.${i}.ranges`)} onChange={(event) => put(i, { ranges: event.currentTarget.value || undefined })} w={240} />
                </Group>
                <Drop label={t("optimise.dropParts", { name: structure.name })} onClick={() => change({ structures: without(form.structures, i) })} />
              </Group>
            </Paper>
          ),
        )}
        <Group>
          <Button variant="default" onClick={add} disabled={!document}>
            {t("optimise.addParts")}
          </Button>
        </Group>
      </Stack>
    </section>
  );
}

const EXAMPLE = '{"blocks": {"lead": {"kind": "lead_lag", …}}, "connections": [{"from": "error", "to": "lead"}]}';
