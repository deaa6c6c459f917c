import { Button, NativeSelect, Popover, Select, Stack } from "@mantine/core";
import { useInfiniteQuery, useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { jobsQuery } from "@/shared/api/jobs";
import { datasetQuery, readyDatasets } from "@/shared/api/datasets";
import { revisionsQuery, systemsQuery } from "@/shared/api/systems";
import type { DesignRef } from "@/shared/systems/compared";

interface Props {
  full: boolean;
  onAdd(ref: DesignRef): void;
  /** Lays a channel of a recording over the curves; left out where there are none. */
  onRecording?: (dataset: string, channel: string) => void;
  /** Of the designs that are compared. */
  outputs?: readonly string[];
}

/** Chooses one more design: a revision of a system, the best of a search that has ended, an identified model; or a recording beside them. */
export function AddDesign({ full, onAdd, onRecording, outputs = [] }: Props) {
  const { t, i18n } = useTranslation();
  const [opened, setOpened] = useState(false);
  const [of, setOf] = useState<string | null>(null);
  const [revision, setRevision] = useState("");
  const [channel, setChannel] = useState("");
  const systems = useInfiniteQuery({ ...systemsQuery(), enabled: opened }).data?.pages.flatMap((page) => page.items) ?? [];
  const searches = useInfiniteQuery({ ...jobsQuery({ kind: "optimization" }), enabled: opened }).data?.pages.flatMap((page) => page.items) ?? [];
  const models = useInfiniteQuery({ ...jobsQuery({ kind: "identification" }), enabled: opened }).data?.pages.flatMap((page) => page.items) ?? [];
  const recordings = useQuery({ ...readyDatasets, enabled: opened && onRecording !== undefined }).data ?? [];
  const recording = recordings.find(({ id }) => id === of);
  const channels = useQuery({ ...datasetQuery(of ?? ""), enabled: recording !== undefined }).data?.channels ?? [];
  // A channel that is called as an output is what is compared with it.
  const measured = channel || String((channels.find((one) => outputs.includes(String(one.name))) ?? channels[0])?.name ?? "");
  const system = systems.find(({ id }) => id === of);
  const revisions = useQuery({ ...revisionsQuery(of ?? ""), enabled: system !== undefined }).data?.items ?? [];
  const names = new Map(systems.map(({ id, name }) => [id, name || id]));
  const found = (jobs: typeof searches) =>
    jobs
      .filter(({ result }) => result !== null)
      .map(({ id, system: own, finished_at, created_at }) => ({ value: id, label: `${names.get(own?.id ?? "") ?? own?.id ?? id}, ${new Date(finished_at ?? created_at).toLocaleString(i18n.language, { dateStyle: "medium", timeStyle: "short" })}` }));
  const choices = [
    { group: t("nav.systems"), items: systems.map(({ id, name }) => ({ value: id, label: name || id })) },
    { group: t("finder.kinds.optima"), items: found(searches) },
    { group: t("compare.models"), items: found(models) },
    { group: t("panel.recordings"), items: recordings.map(({ id, name }) => ({ value: id, label: name || id })) },
  ].filter(({ items }) => items.length > 0);
  const add = () => {
    if (of === null) return;
    if (recording) onRecording?.(of, measured);
    else onAdd(system ? { kind: "revision", id: of, revision: Number(revision || system.revision) } : { kind: "job", id: of });
    setOpened(false);
  };
  return (
    <Popover opened={opened} onChange={setOpened} width={360} position="bottom-end" withinPortal trapFocus>
      <Popover.Target>
        <Button onClick={() => setOpened((now) => !now)} disabled={full}>
          {t("compare.add")}
        </Button>
      </Popover.Target>
      <Popover.Dropdown>
        <Stack gap="xs">
          <Select
            label={t("compare.design")}
            data={choices}
            value={of}
            onChange={(value) => {
              setOf(value);
              setRevision("");
              setChannel("");
            }}
            searchable
            comboboxProps={{ withinPortal: false }}
          />
          {system && <NativeSelect size="xs" label={t("systems.revision")} value={revision || String(system.revision)} data={revisions.map((row) => String(row.revision))} onChange={(event) => setRevision(event.currentTarget.value)} />}
          {recording && <NativeSelect size="xs" label={t("panel.channel")} value={measured} data={channels.map((one) => ({ value: String(one.name), label: one.unit ? `${String(one.name)} [${String(one.unit)}]` : String(one.name) }))} onChange={(event) => setChannel(event.currentTarget.value)} />}
          <Button onClick={add} disabled={of === null || (recording !== undefined && measured === "")}>
            {t(recording ? "panel.overlay" : "compare.add")}
          </Button>
        </Stack>
      </Popover.Dropdown>
    </Popover>
  );
}
