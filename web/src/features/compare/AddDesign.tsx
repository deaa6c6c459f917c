import { Button, NativeSelect, Popover, Select, Stack } from "@mantine/core";
import { useInfiniteQuery, useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { jobsQuery } from "@/shared/api/jobs";
import { revisionsQuery, systemsQuery } from "@/shared/api/systems";
import type { DesignRef } from "@/shared/systems/compared";

/** Chooses one more design: a revision of a system, or the best of a search that has ended. */
export function AddDesign({ full, onAdd }: { full: boolean; onAdd(ref: DesignRef): void }) {
  const { t, i18n } = useTranslation();
  const [opened, setOpened] = useState(false);
  const [of, setOf] = useState<string | null>(null);
  const [revision, setRevision] = useState("");
  const systems = useInfiniteQuery({ ...systemsQuery, enabled: opened }).data?.pages.flatMap((page) => page.items) ?? [];
  const jobs = useInfiniteQuery({ ...jobsQuery({ kind: "optimization" }), enabled: opened }).data?.pages.flatMap((page) => page.items) ?? [];
  const system = systems.find(({ id }) => id === of);
  const revisions = useQuery({ ...revisionsQuery(of ?? ""), enabled: system !== undefined }).data?.items ?? [];
  const names = new Map(systems.map(({ id, name }) => [id, name || id]));
  const choices = [
    { group: t("nav.systems"), items: systems.map(({ id, name }) => ({ value: id, label: name || id })) },
    {
      group: t("finder.kinds.optima"),
      items: jobs
        .filter(({ result }) => result !== null)
        .map(({ id, system: own, finished_at, created_at }) => ({ value: id, label: `${names.get(own?.id ?? "") ?? own?.id ?? id}, ${new Date(finished_at ?? created_at).toLocaleString(i18n.language, { dateStyle: "medium", timeStyle: "short" })}` })),
    },
  ];
  const add = () => {
    if (of === null) return;
    onAdd(system ? { kind: "revision", id: of, revision: Number(revision || system.revision) } : { kind: "search", id: of });
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
            }}
            searchable
            comboboxProps={{ withinPortal: false }}
          />
          {system && <NativeSelect size="xs" label={t("systems.revision")} value={revision || String(system.revision)} data={revisions.map((row) => String(row.revision))} onChange={(event) => setRevision(event.currentTarget.value)} />}
          <Button onClick={add} disabled={of === null}>
            {t("compare.add")}
          </Button>
        </Stack>
      </Popover.Dropdown>
    </Popover>
  );
}
