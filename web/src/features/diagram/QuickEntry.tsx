import { Kbd, Text } from "@mantine/core";
import { useEffect, useId, useMemo, useRef, useState, type KeyboardEvent } from "react";
import { useTranslation } from "react-i18next";
import type { Block, ElementEntry, ParameterEntry, SystemDocument } from "@/shared/api/types";
import { prettyUnit } from "@/shared/units/format";
import { freeName, NAME, portsOf, textOf, type Catalogue, type End } from "./model";
import classes from "./QuickEntry.module.css";
import { blockTyped, kindsLike, matching, readTyped, wiresFrom } from "./quick";

export type Mode = "add" | "connect" | "output" | "find";
interface Item {
  key: string;
  label: string;
  hint: string;
  /** What the text becomes by Tab. */
  text: string;
  /** Says what is wrong, or does it and says nothing. */
  run(): string | undefined;
}

interface Props {
  mode: Mode;
  document: SystemDocument;
  catalogue: Catalogue;
  selected: string | null;
  /** What a new block gets as its first input. */
  from: End | null;
  /** Every block by its path from here. */
  paths: readonly string[];
  onAdd(name: string, block: Block): void;
  onConnect(from: End, to: End): void;
  onOutput(name: string, from: End): void;
  onFind(path: string): void;
  onClose(): void;
}

const SHOWN = 9;

/** One line in which blocks, connections and outputs are typed; the likeliest meaning stands first, Enter takes it. */
export function QuickEntry(props: Props) {
  const { mode, onClose } = props;
  const { t } = useTranslation();
  const id = useId();
  const input = useRef<HTMLInputElement>(null);
  const [text, setText] = useState("");
  const [active, setActive] = useState(0);
  const [wrong, setWrong] = useState<string>();
  const items = useItems(props, text);
  const shown = items.slice(0, SHOWN);
  const index = Math.min(active, shown.length - 1);
  const before = useRef(window.document.activeElement);
  useEffect(() => input.current?.focus(), []);
  const close = () => {
    // Whoever came by the keyboard is where they were.
    if (before.current instanceof HTMLElement) before.current.focus({ preventScroll: true });
    onClose();
  };
  const take = (item: Item | undefined) => {
    const refused = item ? item.run() : t("quick.nothing");
    setWrong(refused);
    if (refused === undefined) close();
    else input.current?.focus();
  };
  const onKey = (event: KeyboardEvent) => {
    const keys: Record<string, () => void> = {
      ArrowDown: () => setActive((index + 1) % Math.max(shown.length, 1)),
      ArrowUp: () => setActive((index - 1 + shown.length) % Math.max(shown.length, 1)),
      Enter: () => take(shown[index]),
      Escape: close,
      Tab: () => shown[index] && setText(shown[index].text),
    };
    event.stopPropagation();
    if (!keys[event.key]) return;
    event.preventDefault();
    keys[event.key]!();
  };
  return (
    <div className={classes.box} role="dialog" aria-label={t(`quick.${mode}`)}>
      <label htmlFor={`${id}-text`} className={classes.label}>
        {t(`quick.${mode}`)}
        {mode === "add" && props.from && <span className={classes.behind}>{t("quick.behind", { from: `${props.from.block}.${props.from.port}` })}</span>}
        {mode !== "add" && mode !== "find" && props.selected && <span className={classes.behind}>{t("quick.of", { name: props.selected })}</span>}
      </label>
      <input
        ref={input}
        id={`${id}-text`}
        className={classes.input}
        value={text}
        placeholder={t(`quick.${mode}Example`)}
        onChange={(event) => {
          setText(event.currentTarget.value);
          setActive(0);
          setWrong(undefined);
        }}
        onKeyDown={onKey}
        onBlur={(event) => !event.currentTarget.closest("[role=dialog]")?.contains(event.relatedTarget) && onClose()}
        role="combobox"
        aria-expanded={shown.length > 0}
        aria-controls={`${id}-list`}
        aria-activedescendant={shown[index] ? `${id}-${index}` : undefined}
        aria-invalid={wrong !== undefined}
        autoComplete="off"
        spellCheck={false}
      />
      {wrong !== undefined && (
        <Text fz="xs" c="var(--mantine-color-error)" role="alert" px={10} pb={6}>
          {wrong}
        </Text>
      )}
      <ul id={`${id}-list`} role="listbox" aria-label={t(`quick.${mode}`)} className={classes.list}>
        {shown.map((item, i) => (
          <li key={item.key} id={`${id}-${i}`} role="option" aria-selected={i === index} className={classes.option} onPointerDown={(event) => event.preventDefault()} onClick={() => take(item)}>
            <span>{item.label}</span>
            <span className={classes.hint}>{item.hint}</span>
          </li>
        ))}
      </ul>
      <div className={classes.foot}>
        <Kbd size="xs">Enter</Kbd> {t("quick.takes")} <Kbd size="xs">Tab</Kbd> {t("quick.completes")} <Kbd size="xs">Esc</Kbd> {t("quick.closes")}
      </div>
    </div>
  );
}

function useItems({ mode, document, catalogue, selected, paths, onAdd, onConnect, onOutput, onFind }: Props, text: string): Item[] {
  const { t } = useTranslation();
  return useMemo<Item[]>(() => {
    if (mode === "add") {
      const typed = readTyped(text);
      const head = typed.name === undefined ? "" : `${typed.name}: `;
      return kindsLike(typed.kind, catalogue)
        .slice(0, SHOWN)
        .map((entry) => ({
          key: entry.kind,
          label: entry.title,
          hint: parametersOf(entry) || entry.kind,
          text: `${head}${entry.kind} `,
          run: () => {
            const made = blockTyped(typed, entry, document);
            if ("rule" in made) return t(`quick.bad.${made.rule}`, { key: made.key, place: made.place ?? "" });
            onAdd(made.name, made.block);
            return undefined;
          },
        }));
    }
    if (mode === "find") return matching(paths, (path) => path, text).slice(0, SHOWN).map((path) => ({ key: path, label: path, hint: "", text: path, run: () => void onFind(path) }));
    if (selected === null) return [];
    if (mode === "connect") {
      return matching(wiresFrom(selected, document, catalogue), (wire) => wire.label, text).slice(0, SHOWN).map((wire) => ({
        key: wire.label,
        label: wire.label,
        hint: wire.instead === undefined ? "" : t("quick.instead", { from: wire.instead }),
        text: wire.label,
        run: () => void onConnect(wire.from, wire.to),
      }));
    }
    const [name, port] = text.includes(":") ? text.split(":").map((part) => part.trim()) : [undefined, text.trim()];
    const ports = portsOf(document.blocks[selected]!, catalogue).outputs;
    const output = (found: string, as: string): Item => ({
      key: `${found} ${as}`,
      label: `${as}: ${textOf({ block: selected, port: found }, document, catalogue, "outputs")}`,
      hint: document.outputs[as] === undefined ? "" : t("quick.instead", { from: document.outputs[as]! }),
      text: `${as}: ${found}`,
      run: () => {
        if (!NAME.test(as)) return t("quick.bad.name", { key: as, place: "" });
        onOutput(as, { block: selected, port: found });
        return undefined;
      },
    });
    if (ports.length === 1) {
      const wanted = name ?? port;
      return [output(ports[0]!, wanted || freeName(selected, Object.keys(document.outputs)))];
    }
    return matching(ports, (found) => found, port ?? "").map((found) => output(found, name ?? freeName(found, Object.keys(document.outputs))));
  }, [mode, text, document, catalogue, selected, paths, onAdd, onConnect, onOutput, onFind, t]);
}

function parametersOf(entry: ElementEntry): string {
  return (entry.parameters as (ParameterEntry & { required?: boolean })[])
    .map((parameter) => (parameter.required ? parameter.name : `${parameter.name}?`) + (prettyUnit(parameter.unit) ? ` [${prettyUnit(parameter.unit)}]` : ""))
    .join("  ");
}
