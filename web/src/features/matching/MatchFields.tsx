import { Button, Group, Select, Stack } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useEffect } from "react";
import { useTranslation } from "react-i18next";
import { Link } from "react-router";
import { datasetQuery, readyDatasets, type Dataset } from "@/shared/api/datasets";
import { systemChoices, systemQuery } from "@/shared/api/systems";
import type { Opened } from "@/shared/live/protocol";
import { describedQuery } from "@/shared/systems/described";
import { Empty } from "@/shared/ui/Empty";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { useQueryText } from "@/shared/ui/useQueryText";
import { readMatch, writeMatch, type Match } from "./address";
import { RecordingFields } from "./RecordingFields";
import { guessed } from "./sources";

export interface Matched {
  match: Match;
  change(part: Partial<Match>): void;
  opened: Opened | undefined;
  dataset: Dataset | undefined;
  error: unknown;
}

/** The system and the recording that the address names, and which channel is what; names that agree are taken for the same. */
export function useMatch(): Matched {
  const [query, setQuery] = useQueryText();
  const match = readMatch(query);
  const change = (part: Partial<Match>) => setQuery((before) => writeMatch(before, { ...readMatch(before), ...part }));
  const system = useQuery({ ...systemQuery(match.system), enabled: match.system !== "" });
  const described = useQuery({ ...describedQuery(match.system, system.data?.revision ?? 0), enabled: system.data !== undefined });
  const dataset = useQuery({ ...datasetQuery(match.dataset), enabled: match.dataset !== "" });
  // What stands below the choice of both comes with their lists: it would move when those come later.
  const listed = [useQuery(systemChoices), useQuery(readyDatasets)].every(({ isSuccess }) => isSuccess);
  const opened = match.system && listed ? described.data : undefined;
  const recording = match.dataset && listed ? dataset.data : undefined;
  const untouched = Object.keys(match.inputs).length + Object.keys(match.outputs).length === 0;
  useEffect(() => {
    if (!opened || !recording || !untouched) return;
    const ports = guessed(opened, recording);
    if (ports) change(ports);
  });
  return { match, change, opened, dataset: recording, error: system.error ?? described.error ?? dataset.error };
}

/** Which system is held against which recording, and which channel is which signal. */
export function MatchFields({ match, change, opened, dataset, error, wrong }: Matched & { wrong(pointer: string): string | undefined }) {
  const { t } = useTranslation();
  const [known, recorded] = [useQuery(systemChoices), useQuery(readyDatasets)];
  const failed = [known, recorded].find(({ isError }) => isError);
  if (failed) return <ProblemAlert error={failed.error} onRetry={() => void failed.refetch()} />;
  if (!known.data || !recorded.data) return null;
  const [systems, datasets] = [known.data, recorded.data];
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
  return (
    <Stack gap="sm">
      <Select label={t("matching.system")} data={systems.map((row) => ({ value: row.id, label: row.name || row.id }))} value={match.system || null} onChange={(value) => value && change({ system: value, inputs: {}, outputs: {} })} searchable error={wrong("/system")} maw={420} />
      <RecordingFields recorded={match} change={change} opened={opened} dataset={dataset} datasets={datasets} wrong={wrong} />
      <ProblemAlert error={error} />
    </Stack>
  );
}
