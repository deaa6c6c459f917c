import { Anchor, NativeSelect, Select, Stack, Table, Text } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { Link } from "react-router";
import type { Opened } from "@/shared/live/protocol";
import { prettyUnit } from "@/shared/units/format";
import { WAYS, type Recorded } from "./address";
import type { Dataset } from "@/shared/api/datasets";
import { channelsOf } from "./sources";

interface Props {
  recorded: Recorded;
  change(part: Partial<Recorded>): void;
  opened: Opened | undefined;
  dataset: Dataset | undefined;
  datasets: { id: string; name: string }[];
  wrong(pointer: string): string | undefined;
}

/** A recording, and which of its channels is which signal of the system. */
export function RecordingFields({ recorded, change, opened, dataset, datasets, wrong }: Props) {
  const { t } = useTranslation();
  const data = [{ value: "", label: t("matching.nothing") }, ...channelsOf(dataset).map(({ name, unit }) => ({ value: name, label: unit ? `${name} [${prettyUnit(unit)}]` : name }))];
  const ways = [{ value: "", label: t("matching.ways.auto") }, ...WAYS.map((way) => ({ value: way, label: t(`matching.ways.${way}`) }))];
  const rows = [
    ...(opened?.inputs ?? []).map((name) => ({ side: "inputs" as const, name, said: t("matching.input", { name }) })),
    ...(opened?.outputs ?? []).map(({ name, unit }) => ({ side: "outputs" as const, name, said: `${t("matching.output", { name })} ${prettyUnit(unit) && `[${prettyUnit(unit)}]`}` })),
  ];
  return (
    <Stack gap="xs">
      <Select label={t("matching.dataset")} data={datasets.map((row) => ({ value: row.id, label: row.name }))} value={recorded.dataset || null} onChange={(value) => value && change({ dataset: value, inputs: {}, outputs: {} })} searchable error={wrong("/dataset")} maw={420} />
      {opened && dataset && (
        <Table maw={820} withRowBorders={false} data-testid="mapping">
          <Table.Thead>
            <Table.Tr>
              <Table.Th>{t("matching.signal")}</Table.Th>
              <Table.Th>{t("matching.channel")}</Table.Th>
              <Table.Th>{t("matching.between")}</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {rows.map(({ side, name, said }) => (
              <Table.Tr key={`${side}.${name}`}>
                <Table.Td>{said}</Table.Td>
                <Table.Td>
                  <Select aria-label={t("matching.channelOf", { name })} data={data} value={recorded[side][name] ?? ""} onChange={(value) => change({ [side]: { ...recorded[side], [name]: value ?? "" } })} error={wrong(`/${side}/${name}`) ?? wrong(`/${side}/${name}/channel`)} />
                </Table.Td>
                <Table.Td>
                  {side === "inputs" && (
                    <NativeSelect aria-label={t("matching.betweenOf", { name })} data={ways} value={recorded.between?.[name] ?? ""} onChange={(event) => change({ between: { ...recorded.between, [name]: event.currentTarget.value } })} />
                  )}
                </Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      )}
      {recorded.dataset && (
        <Text fz="xs">
          <Anchor component={Link} to={`/datasets/${recorded.dataset}`} fz="xs">
            {t("matching.look")}
          </Anchor>
        </Text>
      )}
    </Stack>
  );
}
