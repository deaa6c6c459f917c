import { Button, Checkbox, CloseButton, Group, NativeSelect, Popover, Stack, Text } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { datasetQuery, readyDatasets } from "@/shared/api/datasets";
import type { Opened } from "@/shared/live/protocol";
import { PlainEntry } from "@/shared/ui/PlainEntry";
import { words } from "@/shared/units/format";
import classes from "@/shared/ui/Chip.module.css";
import type { Overlay } from "./view";

interface Props {
  measured: Overlay[];
  opened: Opened;
  output: string;
  onChange(measured: Overlay[]): void;
}

/** Recordings over the curves of one page: the live channel takes no more. */
export const MOST_MEASURED = 4;

/** Which recordings are seen over which curves. */
export function MeasuredSetup({ measured, opened, output, onChange }: Props) {
  const { t } = useTranslation();
  const [choosing, setChoosing] = useState(false);
  const [dataset, setDataset] = useState("");
  const [channel, setChannel] = useState("");
  const [over, setOver] = useState("");
  const [start, setStart] = useState(0);
  const [relative, setRelative] = useState(false);
  const datasets = useQuery({ ...readyDatasets, enabled: choosing }).data ?? [];
  const known = useQuery({ ...datasetQuery(dataset), enabled: dataset !== "" }).data;
  const channels = known?.channels ?? [];
  return (
    <Group gap="xs" align="center" role="group" aria-label={t("panel.recordings")}>
      <Popover opened={choosing} onChange={setChoosing} width={320} position="bottom-start" withinPortal trapFocus>
        <Popover.Target>
          <Button variant="default" onClick={() => setChoosing((now) => !now)} disabled={measured.length >= MOST_MEASURED}>
            {t("panel.overlay")}
          </Button>
        </Popover.Target>
        <Popover.Dropdown>
          <Stack gap="xs">
            <NativeSelect size="xs" label={t("panel.recording")} value={dataset} data={[{ value: "", label: datasets.length > 0 ? t("panel.choose") : t("panel.noRecordings") }, ...datasets.map((one) => ({ value: String(one.id), label: String(one.name || one.id) }))]} onChange={(event) => setDataset(event.currentTarget.value)} />
            <NativeSelect size="xs" label={t("panel.channel")} value={channel} disabled={dataset === ""} data={[{ value: "", label: t("panel.choose") }, ...channels.map((one) => ({ value: String(one.name), label: one.unit ? `${String(one.name)} [${String(one.unit)}]` : String(one.name) }))]} onChange={(event) => setChannel(event.currentTarget.value)} />
            <NativeSelect size="xs" label={t("panel.over")} value={over || output} data={opened.outputs.map((one) => ({ value: one.name, label: words(one.name) }))} onChange={(event) => setOver(event.currentTarget.value)} />
            <PlainEntry label={t("panel.recordingStart")} unit="s" value={start} onCommit={(value) => value !== undefined && setStart(value)} />
            <Checkbox size="xs" label={t("panel.relative")} checked={relative} onChange={(event) => setRelative(event.currentTarget.checked)} />
            <Button
              disabled={dataset === "" || channel === ""}
              onClick={() => {
                onChange([...measured, { output: over || output, dataset, channel, start, relative }]);
                setChoosing(false);
              }}
            >
              {t("panel.overlay")}
            </Button>
            <Text fz="xs" c="dimmed">
              {t("panel.bandDoc")}
            </Text>
          </Stack>
        </Popover.Dropdown>
      </Popover>
      {measured.map((one, i) => (
        <span key={i} className={classes.chip} data-testid="recording">
          {one.channel} → {words(one.output)}
          <CloseButton size="xs" aria-label={t("panel.dropRecording", { channel: one.channel })} onClick={() => onChange(measured.filter((_, k) => k !== i))} />
        </span>
      ))}
    </Group>
  );
}
