import { ScrollArea, Stack, Text, TextInput, UnstyledButton } from "@mantine/core";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import type { ElementEntry } from "@/shared/api/types";
import classes from "./DiagramPage.module.css";
import type { Catalogue } from "./model";

export const DRAGGED = "application/x-servotune-kind";

/** Every kind of block that the service knows: dragged onto the canvas, or put there by Enter. */
export function Palette({ catalogue, onAdd }: { catalogue: Catalogue; onAdd(entry: ElementEntry): void }) {
  const { t } = useTranslation();
  const [search, setSearch] = useState("");
  const wanted = search.toLowerCase();
  const shown = [...catalogue.values()].filter((entry) => `${entry.kind.replaceAll("_", " ")} ${entry.title}`.toLowerCase().includes(wanted));
  return (
    <Stack gap={6} h="100%">
      <TextInput aria-label={t("diagram.search")} placeholder={t("diagram.search")} value={search} onChange={(event) => setSearch(event.currentTarget.value)} type="search" />
      <ScrollArea style={{ flex: 1 }} type="auto" viewportProps={{ tabIndex: 0, "aria-label": t("diagram.palette"), role: "group" }}>
        {shown.map((entry) => (
          <UnstyledButton
            key={entry.kind}
            className={classes.entry}
            draggable
            onDragStart={(event) => {
              event.dataTransfer.setData(DRAGGED, entry.kind);
              event.dataTransfer.effectAllowed = "copy";
            }}
            onClick={() => onAdd(entry)}
            title={entry.equation}
            data-kind={entry.kind}
          >
            <Text span fz="xs" fw={500} display="block">
              {entry.title}
            </Text>
            <Text span fz={11} c="dimmed" className="numbers">
              {entry.kind}
            </Text>
          </UnstyledButton>
        ))}
        {shown.length === 0 && <Text fz="sm">{t("diagram.noKind")}</Text>}
      </ScrollArea>
    </Stack>
  );
}
