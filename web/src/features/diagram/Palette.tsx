import { ScrollArea, Stack, Text, TextInput, UnstyledButton } from "@mantine/core";
import { useMemo, useState } from "react";
import { useTranslation } from "react-i18next";
import type { ElementEntry } from "@/shared/api/types";
import classes from "./DiagramPage.module.css";
import { groupsOf, keepRecent, recentKinds, symbolOf } from "./groups";
import type { Catalogue } from "./model";

export const DRAGGED = "application/x-servotune-kind";

/** Every kind of block that the service knows, in groups, the last used first: dragged onto the canvas, or put there by Enter. */
export function Palette({ catalogue, onAdd }: { catalogue: Catalogue; onAdd(entry: ElementEntry): void }) {
  const { t } = useTranslation();
  const [search, setSearch] = useState("");
  const [recent, setRecent] = useState(recentKinds);
  const groups = useMemo(() => groupsOf(catalogue.values()), [catalogue]);
  const wanted = search.trim().toLowerCase();
  const found = groups.map(({ group, entries }) => ({ group, entries: entries.filter((entry) => `${entry.kind.replaceAll("_", " ")} ${entry.title} ${t(`diagram.groups.${group}`)}`.toLowerCase().includes(wanted)) })).filter(({ entries }) => entries.length > 0);
  const last = wanted === "" ? recent.flatMap((kind) => catalogue.get(kind) ?? []) : [];
  const used = (kind: string) => {
    keepRecent(kind);
    setRecent(recentKinds());
  };
  const row = (entry: ElementEntry, again: boolean) => (
    <UnstyledButton
      key={entry.kind}
      className={classes.entry}
      draggable
      onDragStart={(event) => {
        event.dataTransfer.setData(DRAGGED, entry.kind);
        event.dataTransfer.effectAllowed = "copy";
      }}
      onDragEnd={(event) => event.dataTransfer.dropEffect !== "none" && used(entry.kind)}
      onClick={() => {
        onAdd(entry);
        used(entry.kind);
      }}
      title={entry.equation}
      {...(again ? { "data-recent": entry.kind } : { "data-kind": entry.kind })}
    >
      <span className={classes.symbol} aria-hidden>
        {symbolOf(entry.kind)}
      </span>
      <Text span fz="xs" fw={500}>
        {entry.title}
      </Text>
    </UnstyledButton>
  );
  return (
    <Stack gap={6} h="100%">
      <TextInput aria-label={t("diagram.search")} placeholder={t("diagram.search")} value={search} onChange={(event) => setSearch(event.currentTarget.value)} type="search" />
      <ScrollArea style={{ flex: 1 }} type="auto" viewportProps={{ tabIndex: 0, "aria-label": t("diagram.palette"), role: "group" }}>
        {[...(last.length > 0 ? [{ group: "recent", entries: last }] : []), ...found].map(({ group, entries }) => (
          <section key={group} aria-label={t(`diagram.groups.${group}`)}>
            <Text fz={11} fw={700} c="dimmed" mt={6} px={4}>
              {t(`diagram.groups.${group}`)}
            </Text>
            {entries.map((entry) => row(entry, group === "recent"))}
          </section>
        ))}
        {found.length === 0 && <Text fz="sm">{t("diagram.noKind")}</Text>}
      </ScrollArea>
    </Stack>
  );
}
