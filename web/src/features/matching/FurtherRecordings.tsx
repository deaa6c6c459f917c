import { Button, Group, NumberInput, Paper, TextInput, Title } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useEffect } from "react";
import { useTranslation } from "react-i18next";
import type { Opened } from "@/shared/live/protocol";
import { readKnown, type Experiment } from "./address";
import { RecordingFields } from "./RecordingFields";
import { datasetQuery, readyDatasets } from "@/shared/api/datasets";
import { guessed } from "./sources";

interface Props {
  more: Experiment[];
  opened: Opened;
  onChange(more: Experiment[]): void;
  wrong(pointer: string): string | undefined;
}

/** Further recordings that the same values must explain, each with its channels and with what is known of it alone. */
export function FurtherRecordings({ more, opened, onChange, wrong }: Props) {
  const { t } = useTranslation();
  return (
    <>
      {more.map((experiment, i) => (
        <FurtherRecording key={i} number={i + 2} experiment={experiment} opened={opened} onChange={(next) => onChange(more.flatMap((one, k) => (k !== i ? [one] : next ? [next] : [])))} wrong={(pointer) => wrong(`/experiments/${i + 1}${pointer}`)} />
      ))}
      <Group>
        <Button variant="default" onClick={() => onChange([...more, { dataset: "", inputs: {}, outputs: {}, split: 0.5, known: "" }])}>
          {t("matching.further")}
        </Button>
      </Group>
    </>
  );
}

function FurtherRecording({ number, experiment, opened, onChange, wrong }: { number: number; experiment: Experiment; opened: Opened; onChange(next: Experiment | null): void; wrong(pointer: string): string | undefined }) {
  const { t } = useTranslation();
  const choices = useQuery(readyDatasets);
  const dataset = useQuery({ ...datasetQuery(experiment.dataset), enabled: experiment.dataset !== "" }).data;
  const untouched = Object.keys(experiment.inputs).length + Object.keys(experiment.outputs).length === 0;
  useEffect(() => {
    if (!dataset || !untouched) return;
    const ports = guessed(opened, dataset);
    if (ports) onChange({ ...experiment, ...ports });
  });
  return (
    <Paper withBorder p="sm" component="section" aria-labelledby={`recording-${number}`} data-testid="further">
      <Group justify="space-between" mb="xs">
        <Title order={2} id={`recording-${number}`}>
          {t("matching.recordingOf", { number })}
        </Title>
        <Button size="compact-xs" variant="subtle" color="red" onClick={() => onChange(null)} aria-label={t("matching.dropRecording", { number })}>
          ×
        </Button>
      </Group>
      <RecordingFields recorded={experiment} change={(part) => onChange({ ...experiment, ...part })} opened={opened} dataset={experiment.dataset ? dataset : undefined} datasets={choices.data ?? []} wrong={wrong} />
      <Group align="flex-start" mt="xs">
        <NumberInput size="xs" w={190} label={t("matching.split")} description={t("matching.splitAll")} min={0} max={100} suffix=" %" hideControls value={Math.round(experiment.split * 1000) / 10} onChange={(value) => typeof value === "number" && onChange({ ...experiment, split: value / 100 })} error={wrong("/split")} />
        <TextInput w={300} label={t("matching.known")} description={t("matching.knownDoc")} placeholder="load = 25 kg; current = 0.5" value={experiment.known} onChange={(event) => onChange({ ...experiment, known: event.currentTarget.value })} error={readKnown(experiment.known) === undefined ? t("optimise.badScenario") : wrong("/parameters")} />
      </Group>
    </Paper>
  );
}
