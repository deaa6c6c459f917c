import { Button, NativeSelect, Popover, Select, Stack } from "@mantine/core";
import { useInfiniteQuery, useQuery } from "@tanstack/react-query";
import { useState, type MouseEvent } from "react";
import { useTranslation } from "react-i18next";
import { jobsQuery } from "@/shared/api/jobs";
import { datasetQuery, datasetsQuery } from "@/shared/api/datasets";
import { revisionsQuery, systemsQuery } from "@/shared/api/systems";
import type { JobReply } from "@/shared/api/types";
import type { DesignRef } from "@/shared/systems/compared";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { useAsked } from "@/shared/ui/useAsked";

interface Props {
  full: boolean;
  onAdd(ref: DesignRef): void;
  /** Lays a channel of a recording over the curves; left out where there are none. */
  onRecording?: (dataset: string, channel: string) => void;
  /** Of the designs that are compared. */
  outputs?: readonly string[];
}

const rowsOf = <Row,>(data: { pages: { items: Row[] }[] } | undefined) => data?.pages.flatMap((page) => page.items) ?? [];

const stay = (event: MouseEvent) => {
  event.preventDefault();
  event.stopPropagation();
};

/** Chooses one more design: a revision of a system, the best of a search that has ended, an identified model; or a recording beside them. */
export function AddDesign({ full, onAdd, onRecording, outputs = [] }: Props) {
  const { t, i18n } = useTranslation();
  const [opened, setOpened] = useState(false);
  const [of, setOf] = useState<string | null>(null);
  const [revision, setRevision] = useState("");
  const [channel, setChannel] = useState("");
  const [search, setSearch] = useState("");
  const asked = useAsked(search);
  const lists = {
    systems: useInfiniteQuery({ ...systemsQuery(asked), enabled: opened }),
    searches: useInfiniteQuery({ ...jobsQuery({ kind: "optimization" }), enabled: opened }),
    models: useInfiniteQuery({ ...jobsQuery({ kind: "identification" }), enabled: opened }),
    recordings: useInfiniteQuery({ ...datasetsQuery({ name: asked, status: "ready" }), enabled: opened && onRecording !== undefined }),
  };
  const systems = rowsOf(lists.systems.data);
  const recordings = rowsOf(lists.recordings.data);
  const recording = of?.startsWith("ds_") ?? false;
  const channels = useQuery({ ...datasetQuery(of ?? ""), enabled: recording }).data?.channels ?? [];
  // A channel that is called as an output is what is compared with it.
  const measured = channel || String((channels.find((one) => outputs.includes(String(one.name))) ?? channels[0])?.name ?? "");
  const system = of?.startsWith("sys_") ?? false;
  const revisions = useQuery({ ...revisionsQuery(of ?? ""), enabled: system }).data?.items ?? [];
  const newest = String(Math.max(0, ...revisions.map((row) => row.revision)));
  // Searches bear the names of their systems, also of those that what was typed leaves out.
  const named = useInfiniteQuery({ ...systemsQuery(), enabled: opened }).data;
  const names = new Map([...rowsOf(named), ...systems].map(({ id, name }) => [id, name || id]));
  const found = (jobs: JobReply[]) =>
    jobs
      .filter(({ result }) => result !== null)
      .map(({ id, system: own, finished_at, created_at }) => ({ value: id, label: `${names.get(own?.id ?? "") ?? own?.id ?? id}, ${new Date(finished_at ?? created_at).toLocaleString(i18n.language, { dateStyle: "medium", timeStyle: "short" })}` }));
  const choices = [
    { group: t("nav.systems"), items: systems.map(({ id, name }) => ({ value: id, label: name || id })) },
    { group: t("finder.kinds.optima"), items: found(rowsOf(lists.searches.data)) },
    { group: t("compare.models"), items: found(rowsOf(lists.models.data)) },
    { group: t("panel.recordings"), items: recordings.map(({ id, name }) => ({ value: id, label: name || id })) },
  ].filter(({ items }) => items.length > 0);
  const more = Object.values(lists).filter((list) => list.hasNextPage);
  const add = () => {
    if (of === null) return;
    if (recording) onRecording?.(of, measured);
    else onAdd(system ? { kind: "revision", id: of, revision: Number(revision || newest) } : { kind: "job", id: of });
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
            searchValue={search}
            onSearchChange={setSearch}
            rightSectionWidth={more.length > 0 ? 110 : undefined}
            rightSectionPointerEvents="all"
            rightSection={
              more.length > 0 && (
                // Beside the field, where the open list does not cover it; a press leaves the focus there, and the list open.
                <Button variant="subtle" size="compact-xs" loading={more.some((list) => list.isFetchingNextPage)} onMouseDown={stay} onTouchStart={(event) => event.stopPropagation()} onClick={() => more.forEach((list) => void list.fetchNextPage())}>
                  {t("systems.further")}
                </Button>
              )
            }
            comboboxProps={{ withinPortal: false }}
          />
          <ProblemAlert error={Object.values(lists).find((list) => list.error)?.error} />
          {system && <NativeSelect size="xs" label={t("systems.revision")} value={revision || newest} data={revisions.map((row) => String(row.revision))} onChange={(event) => setRevision(event.currentTarget.value)} />}
          {recording && <NativeSelect size="xs" label={t("panel.channel")} value={measured} data={channels.map((one) => ({ value: String(one.name), label: one.unit ? `${String(one.name)} [${String(one.unit)}]` : String(one.name) }))} onChange={(event) => setChannel(event.currentTarget.value)} />}
          <Button onClick={add} disabled={of === null || (recording && measured === "") || (system && revisions.length === 0)}>
            {t(recording ? "panel.overlay" : "compare.add")}
          </Button>
        </Stack>
      </Popover.Dropdown>
    </Popover>
  );
}
