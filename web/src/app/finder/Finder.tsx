import { Modal, Text, TextInput } from "@mantine/core";
import { useQueries } from "@tanstack/react-query";
import { useEffect, useId, useMemo, useState, type KeyboardEvent } from "react";
import { useTranslation } from "react-i18next";
import { useNavigate } from "react-router";
import classes from "./Finder.module.css";
import { found, indexOf, type Entry } from "./match";
import { sourceQuery, SOURCES } from "./sources";

/** Looks through everything that can be opened; the focus stays in the field, arrow keys walk through what was found. */
export function Finder({ text, onText, onClose }: { text: string; onText(text: string): void; onClose(): void }) {
  const { t, i18n } = useTranslation();
  const navigate = useNavigate();
  const own = useId();
  const [at, setAt] = useState(0);
  const sources = useQueries({ queries: SOURCES.map((kind) => sourceQuery(kind, t, i18n.language)) });
  const states = sources.map(({ dataUpdatedAt, status }) => `${dataUpdatedAt}${status}`).join();
  // Made anew when a source has answered, not for every letter.
  const index = useMemo(() => indexOf(sources.flatMap(({ data }) => data?.entries ?? [])), [states]);
  const groups = useMemo(() => found(index, text), [index, text]);
  const options = groups.flatMap(({ entries }) => entries);
  const chosen = Math.min(at, options.length - 1);
  const named = (which: (source: (typeof sources)[number]) => boolean | undefined) => SOURCES.filter((_, i) => which(sources[i]!)).map((kind) => t(`finder.kinds.${kind}`)).join(", ");
  const failed = named(({ isError }) => isError);
  const cut = named(({ data }) => data?.cut);
  const pending = sources.some(({ isPending }) => isPending);

  const open = (entry: Entry | undefined, apart: boolean) => {
    if (!entry) return;
    if (apart) return void window.open(entry.to, "_blank", "noopener");
    onClose();
    if (entry.outside) window.location.assign(entry.to);
    else void navigate(entry.to);
  };
  const press = (event: KeyboardEvent) => {
    // While signs are composed, Enter ends the composition.
    if (event.nativeEvent.isComposing) return;
    const last = options.length - 1;
    const to = { ArrowDown: chosen < last ? chosen + 1 : 0, ArrowUp: chosen > 0 ? chosen - 1 : last, PageDown: Math.min(last, chosen + 6), PageUp: Math.max(0, chosen - 6) }[event.key];
    if (to !== undefined) setAt(to);
    else if (event.key === "Enter") open(options[chosen], event.ctrlKey || event.metaKey);
    else return;
    event.preventDefault();
  };
  const idOf = (place: number) => `${own}-${place}`;
  useEffect(() => {
    document.getElementById(idOf(chosen))?.scrollIntoView({ block: "nearest" });
  });

  let place = -1;
  return (
    <Modal opened onClose={onClose} title={t("finder.label")} size="lg" yOffset="8vh" closeButtonProps={{ "aria-label": t("tour.close") }}>
      <TextInput
        aria-label={t("finder.label")}
        description={t("finder.keys")}
        placeholder={t("finder.placeholder")}
        size="sm"
        value={text}
        onChange={(event) => {
          onText(event.currentTarget.value);
          setAt(0);
        }}
        onKeyDown={press}
        data-autofocus
        role="combobox"
        aria-expanded={options.length > 0}
        aria-autocomplete="list"
        aria-controls={`${own}-list`}
        aria-activedescendant={options.length > 0 ? idOf(chosen) : undefined}
        autoComplete="off"
        spellCheck={false}
      />
      <Text fz="xs" c="dimmed" mt={6} role="status" data-testid="finder-state" data-pending={pending}>
        {pending ? t("finder.loading") : options.length === 0 ? t("finder.none", { text: text.trim() }) : t("finder.found", { count: groups.reduce((sum, { entries, more }) => sum + entries.length + more, 0) })}
        {failed && ` ${t("finder.failed", { kinds: failed })}`}
        {cut && ` ${t("finder.cut", { kinds: cut })}`}
      </Text>
      <div id={`${own}-list`} role="listbox" aria-label={t("finder.label")} className={classes.list} data-testid="found">
        {groups.map(({ kind, entries, more }) => (
          <div key={kind} role="group" aria-labelledby={`${own}-${kind}`}>
            <div id={`${own}-${kind}`} role="presentation" className={classes.group}>
              {t(`finder.kinds.${kind}`)}
              {more > 0 && ` · ${t("finder.more", { count: more })}`}
            </div>
            {entries.map((entry) => {
              const mine = ++place;
              return (
                <div key={`${entry.to} ${mine}`} id={idOf(mine)} role="option" aria-selected={mine === chosen} data-kind={kind} className={classes.option} onMouseMove={() => mine !== chosen && setAt(mine)} onClick={(event) => open(entry, event.ctrlKey || event.metaKey)}>
                  <span>{entry.title}</span>
                  <span className={classes.about}>{entry.about}</span>
                </div>
              );
            })}
          </div>
        ))}
      </div>
    </Modal>
  );
}
