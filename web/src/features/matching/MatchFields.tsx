import { Anchor, Button, Group, Select, Stack, Table, Text } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useEffect } from "react";
import { useTranslation } from "react-i18next";
import { Link, useSearchParams } from "react-router";
import { systemQuery } from "@/shared/api/systems";
import type { Opened } from "@/shared/live/protocol";
import { describedQuery } from "@/shared/systems/described";
import { Empty } from "@/shared/ui/Empty";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { prettyUnit } from "@/shared/units/format";
import { readMatch, writeMatch, type Match } from "./address";
import { channelsOf, choicesQuery, datasetQuery, likely, type Dataset } from "./sources";

export interface Matched {
  match: Match;
  change(part: Partial<Match>): void;
  opened: Opened | undefined;
  dataset: Dataset | undefined;
  error: unknown;
}

/** The system and the recording that the address names, and which channel is what; names that agree are taken for the same. */
export function useMatch(): Matched {
  const [query, setQuery] = useSearchParams();
  const match = readMatch(query);
  const change = (part: Partial<Match>) => setQuery((before) => writeMatch(before, { ...readMatch(before), ...part }), { replace: true });
  const system = useQuery({ ...systemQuery(match.system), enabled: match.system !== "" });
  const described = useQuery({ ...describedQuery(match.system, system.data?.revision ?? 0), enabled: system.data !== undefined });
  const dataset = useQuery({ ...datasetQuery(match.dataset), enabled: match.dataset !== "" });
  const opened = match.system ? described.data : undefined;
  const recording = match.dataset ? dataset.data : undefined;
  const untouched = Object.keys(match.inputs).length + Object.keys(match.outputs).length === 0;
  useEffect(() => {
    if (!opened || !recording || !untouched) return;
    const channels = channelsOf(recording);
    const inputs = Object.fromEntries(opened.inputs.map((port) => [port, likely(port, channels)]));
    const outputs = Object.fromEntries(opened.outputs.map(({ name }) => [name, likely(name, channels)]));
    if (Object.values({ ...inputs, ...outputs }).some((channel) => channel !== "")) change({ inputs, outputs });
  });
  return { match, change, opened, dataset: recording, error: system.error ?? described.error ?? dataset.error };
}

/** Which system is held against which recording, and which channel is which signal. */
export function MatchFields({ match, change, opened, dataset, error, wrong }: Matched & { wrong(pointer: string): string | undefined }) {
  const { t } = useTranslation();
  const choices = useQuery(choicesQuery);
  if (choices.isError) return <ProblemAlert error={choices.error} onRetry={() => void choices.refetch()} />;
  if (!choices.data) return null;
  const { systems, datasets } = choices.data;
  if (systems.length === 0 || datasets.length === 0) {
    return (
      <Empty
        title={t("matching.none")}
        action={
          <Group>
            <Button component={Link} to="/systems">
              {t("nav.systems")}
            </Button>
            <Button component={Link} to="/datasets" variant="default">
              {t("nav.datasets")}
            </Button>
          </Group>
        }
      >
        {t("matching.noneDoc")}
      </Empty>
    );
  }
  const channels = channelsOf(dataset);
  const data = [{ value: "", label: t("matching.nothing") }, ...channels.map(({ name, unit }) => ({ value: name, label: unit ? `${name} [${prettyUnit(unit)}]` : name }))];
  return (
    <Stack gap="sm">
      <Group grow preventGrowOverflow={false} align="flex-start">
        <Select label={t("matching.system")} data={systems.map((row) => ({ value: row.id, label: row.name || row.id }))} value={match.system || null} onChange={(value) => value && change({ system: value, inputs: {}, outputs: {} })} searchable error={wrong("/system")} />
        <Select label={t("matching.dataset")} data={datasets.map((row) => ({ value: row.id, label: row.name }))} value={match.dataset || null} onChange={(value) => value && change({ dataset: value, inputs: {}, outputs: {} })} searchable error={wrong("/dataset")} />
      </Group>
      <ProblemAlert error={error} />
      {opened && dataset && (
        <Table maw={640} withRowBorders={false} data-testid="mapping">
          <Table.Thead>
            <Table.Tr>
              <Table.Th>{t("matching.signal")}</Table.Th>
              <Table.Th>{t("matching.channel")}</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {opened.inputs.map((port) => (
              <Table.Tr key={`in.${port}`}>
                <Table.Td>{t("matching.input", { name: port })}</Table.Td>
                <Table.Td>
                  <Select aria-label={t("matching.channelOf", { name: port })} data={data} value={match.inputs[port] ?? ""} onChange={(value) => change({ inputs: { ...match.inputs, [port]: value ?? "" } })} error={wrong(`/inputs/${port}`)} />
                </Table.Td>
              </Table.Tr>
            ))}
            {opened.outputs.map(({ name, unit }) => (
              <Table.Tr key={`out.${name}`}>
                <Table.Td>
                  {t("matching.output", { name })} {prettyUnit(unit) && `[${prettyUnit(unit)}]`}
                </Table.Td>
                <Table.Td>
                  <Select aria-label={t("matching.channelOf", { name })} data={data} value={match.outputs[name] ?? ""} onChange={(value) => change({ outputs: { ...match.outputs, [name]: value ?? "" } })} error={wrong(`/outputs/${name}`)} />
                </Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      )}
      {match.dataset && (
        <Text fz="xs">
          <Anchor component={Link} to={`/datasets/${match.dataset}`} fz="xs">
            {t("matching.look")}
          </Anchor>
        </Text>
      )}
    </Stack>
  );
}
