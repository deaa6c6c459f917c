import { ActionIcon, Button, Group, Kbd, NativeSelect, Select, Stack, Text, Textarea, TextInput, Title } from "@mantine/core";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import type { Problem } from "@/shared/api/problem";
import type { Block, ParameterDocument, Scalar, SystemDocument } from "@/shared/api/types";
import { NumberEntry } from "@/shared/ui/NumberEntry";
import { useDraft } from "@/shared/ui/useDraft";
import { connect, connectionsOf, disconnect, endOf, freeName, isTaken, NAME, portsOf, removeBlocks, textOf, withOutput, type Catalogue } from "./model";
import classes from "./Inspector.module.css";
import { readParameter } from "./quick";
import { ValueEntry } from "./ValueEntry";

interface Props {
  document: SystemDocument;
  catalogue: Catalogue;
  selected: string | null;
  problem: Problem | null;
  /** Where this document stands in what the service was asked. */
  pointer: string;
  onEdit(document: SystemDocument): void;
  onSelect(name: string | null): void;
  onRename(before: string, after: string): void;
  onRenameOutput(before: string, after: string): void;
  onEnter(name: string): void;
}

/** What is selected, with everything that can be said about it; the whole system when nothing is. */
export function Inspector(props: Props) {
  const block = props.selected ? props.document.blocks[props.selected] : undefined;
  return block ? <BlockPart key={props.selected} {...props} name={props.selected!} block={block} /> : <SystemPart {...props} />;
}

function BlockPart({ document, catalogue, name, block, problem, pointer, onEdit, onSelect, onRename, onEnter }: Props & { name: string; block: Block }) {
  const { t } = useTranslation();
  const entry = catalogue.get(block.kind);
  const ports = portsOf(block, catalogue);
  const here = `${pointer}/blocks/${name}`;
  const set = (key: string, value: unknown) => {
    const next = { ...block };
    if (value === undefined) delete next[key];
    else next[key] = value;
    onEdit({ ...document, blocks: { ...document.blocks, [name]: next } });
  };
  const sources = Object.entries(document.blocks).flatMap(([other, found]) => portsOf(found, catalogue).outputs.map((port) => textOf({ block: other, port }, document, catalogue, "outputs")));
  const sourceOf = (port: string): string => {
    const wire = connectionsOf(document).find((w) => {
      const end = endOf(w.to, document, catalogue, "inputs");
      return end.block === name && end.port === port;
    });
    return wire ? textOf(endOf(wire.from, document, catalogue, "outputs"), document, catalogue, "outputs") : "";
  };
  return (
    <Stack gap="xs">
      <Title order={2} fz="sm">
        {entry?.title ?? block.kind}
      </Title>
      <NameEntry
        data-name
        label={t("diagram.blockName")}
        value={name}
        taken={Object.keys(document.blocks)}
        onCommit={(next) => onRename(name, next)}
      />
      {problem?.at(here) && (
        <Text fz="xs" c="var(--mantine-color-error)" role="alert">
          {problem.at(here)}
        </Text>
      )}
      {block.system && (
        <Button variant="light" onClick={() => onEnter(name)}>
          {t("diagram.enter")}
        </Button>
      )}
      {entry?.parameters.map((parameter) => (
        <ValueEntry key={parameter.name} data-parameter parameter={parameter} value={block[parameter.name]} error={problem?.at(`${here}/${parameter.name}`)} onCommit={(value) => set(parameter.name, value)} />
      ))}
      {ports.inputs.length > 0 && (
        <Title order={3} fz="xs" mt={4}>
          {t("diagram.signals")}
        </Title>
      )}
      {ports.inputs.map((port) => (
        <NativeSelect
          key={port}
          size="xs"
          label={t("diagram.fromTo", { port })}
          value={sourceOf(port)}
          data={["", ...sources]}
          onChange={(event) => {
            const to = { block: name, port };
            const from = event.currentTarget.value;
            onEdit(from ? connect(document, catalogue, endOf(from, document, catalogue, "outputs"), to) : disconnect(document, catalogue, to));
          }}
        />
      ))}
      {ports.outputs.length > 0 && (
        <Group gap={6}>
          {ports.outputs.map((port) => (
            <Button
              key={port}
              variant="default"
              size="compact-xs"
              onClick={() => onEdit(withOutput(document, catalogue, freeName(port === "out" ? name : port, Object.keys(document.outputs)), { block: name, port }))}
            >
              {t("diagram.makeOutput", { port })}
            </Button>
          ))}
        </Group>
      )}
      {entry?.equation && (
        <Text fz="xs" c="dimmed" className="numbers">
          {entry.equation}
        </Text>
      )}
      <Button
        variant="subtle"
        color="red"
        onClick={() => {
          onEdit(removeBlocks(document, new Set([name])));
          onSelect(null);
        }}
      >
        {t("diagram.removeBlock", { name })}
      </Button>
    </Stack>
  );
}

function SystemPart({ document, catalogue, problem, pointer, onEdit, onRenameOutput }: Props) {
  const { t } = useTranslation();
  const parameters = document.parameters ?? {};
  const setParameter = (name: string, parameter: ParameterDocument | undefined) => {
    const next = { ...parameters };
    if (parameter) next[name] = parameter;
    else delete next[name];
    onEdit({ ...document, parameters: next });
  };
  const sources = Object.entries(document.blocks).flatMap(([other, found]) => portsOf(found, catalogue).outputs.map((port) => textOf({ block: other, port }, document, catalogue, "outputs")));
  return (
    <Stack gap="xs">
      <Title order={2} fz="sm">
        {t("diagram.system")}
      </Title>
      <TextEntry label={t("systems.name")} value={document.name ?? ""} onCommit={(name) => onEdit({ ...document, name })} />
      <TextEntry label={t("diagram.notes")} value={document.doc ?? ""} onCommit={(doc) => onEdit({ ...document, doc })} lines />
      <Title order={3} fz="xs" mt={4}>
        {t("diagram.parameters")}
      </Title>
      <Text fz="xs" c="dimmed">
        {t("diagram.parametersDoc")}
      </Text>
      {Object.entries(parameters).map(([name, parameter]) => (
        <ParameterRow
          key={name}
          name={name}
          parameter={parameter}
          fault={(key) => problem?.at(`${pointer}/parameters/${name}${key ? `/${key}` : ""}`)}
          onCommit={(next) => setParameter(name, next)}
        />
      ))}
      <Adder label={t("diagram.newParameter")} taken={Object.keys(parameters)} onAdd={setParameter} />
      <Title order={3} fz="xs" mt={4}>
        {t("diagram.outputs")}
      </Title>
      {Object.entries(document.outputs).map(([name, end]) => (
        <Group key={name} gap={4} align="flex-end" wrap="nowrap">
          <NameEntry label={t("diagram.outputName", { name })} value={name} taken={Object.keys(document.outputs)} onCommit={(next) => onRenameOutput(name, next)} />
          <Select label={t("diagram.outputSignal")} aria-label={name} value={textOf(endOf(end, document, catalogue, "outputs"), document, catalogue, "outputs")} data={[...new Set(sources)]} onChange={(value) => value && onEdit({ ...document, outputs: { ...document.outputs, [name]: value } })} error={problem?.at(`${pointer}/outputs/${name}`)} />
          <ActionIcon
            variant="subtle"
            color="gray"
            aria-label={t("diagram.removeOutput", { name })}
            onClick={() => onEdit({ ...document, outputs: Object.fromEntries(Object.entries(document.outputs).filter(([key]) => key !== name)) })}
          >
            ×
          </ActionIcon>
        </Group>
      ))}
      <Keys />
    </Stack>
  );
}

const KEYS = ["A", "C", "O", "/", "Enter", "Alt+↑", "F", "L", "F2", "Ctrl+G", "Ctrl+Shift+G", "Ctrl+Z", "Ctrl+C", "Del", "Ctrl+S"] as const;

function Keys() {
  const { t } = useTranslation();
  return (
    <details className={classes.keys}>
      <summary>{t("diagram.keys")}</summary>
      <dl>
        {KEYS.map((key) => (
          <div key={key}>
            <dt>
              <Kbd size="xs">{key}</Kbd>
            </dt>
            <dd>{t(`diagram.key.${key.replace("↑", "Up")}`)}</dd>
          </div>
        ))}
      </dl>
    </details>
  );
}

/** A value that blocks share, between its bounds; its unit and what it means behind a fold. */
function ParameterRow({ name, parameter, fault, onCommit }: { name: string; parameter: ParameterDocument; fault(key: string): string | undefined; onCommit(parameter: ParameterDocument | undefined): void }) {
  const { t } = useTranslation();
  const set = (key: keyof ParameterDocument, value: unknown) => {
    const next = { ...parameter };
    if (value === undefined || value === "") delete next[key];
    else Object.assign(next, { [key]: value });
    onCommit(next);
  };
  const part = (key: "value" | "lower" | "upper", label: string) => (
    <NumberEntry label={label} value={parameter[key]} unit={key === "value" ? parameter.unit : undefined} expressions={key === "value"} optional={key !== "value"} error={fault(key)} onCommit={(value: Scalar | undefined) => set(key, value)} />
  );
  return (
    <div className={classes.parameter}>
      <Group gap={4} align="flex-end" wrap="nowrap">
        {part("value", name)}
        <ActionIcon variant="subtle" color="gray" aria-label={t("diagram.removeParameter", { name })} onClick={() => onCommit(undefined)}>
          ×
        </ActionIcon>
      </Group>
      <Group gap={4} align="flex-end" wrap="nowrap">
        {part("lower", "≥")}
        {part("upper", "≤")}
        <TextEntry label={t("diagram.unit")} value={parameter.unit ?? ""} onCommit={(unit) => set("unit", unit)} />
      </Group>
      {fault("unit") && (
        <Text fz="xs" c="var(--mantine-color-error)">
          {fault("unit")}
        </Text>
      )}
      {parameter.doc && (
        <Text fz="xs" c="dimmed">
          {parameter.doc}
        </Text>
      )}
    </div>
  );
}

function TextEntry({ label, value, onCommit, lines = false }: { label: string; value: string; onCommit(value: string): void; lines?: boolean }) {
  const { text, type, take } = useDraft(value);
  const commit = () => take() && text !== value && onCommit(text);
  if (lines) return <Textarea label={label} value={text} maxLength={2000} autosize minRows={1} maxRows={6} onChange={(event) => type(event.currentTarget.value)} onBlur={commit} />;
  return <TextInput label={label} value={text} maxLength={200} onChange={(event) => type(event.currentTarget.value)} onBlur={commit} onKeyDown={(event) => event.key === "Enter" && commit()} />;
}

function NameEntry({ label, value, taken, onCommit, ...rest }: { label: string; "data-name"?: boolean; value: string; taken: string[]; onCommit(value: string): void }) {
  const { t } = useTranslation();
  const { text, type, take } = useDraft(value);
  const wrong = text !== value && (!NAME.test(text) ? t("diagram.badName") : isTaken(text, taken.filter((other) => other !== value)) ? t("diagram.takenName") : undefined);
  const commit = () => {
    if (take() && text !== value && !wrong) onCommit(text);
  };
  return <TextInput wrapperProps={rest} label={label} value={text} onChange={(event) => type(event.currentTarget.value)} onBlur={commit} onKeyDown={(event) => event.key === "Enter" && commit()} error={wrong} spellCheck={false} classNames={{ input: "numbers" }} />;
}

/** `kp`, or with everything at once: `area = 20 cm**2 [10, 50]`. */
function Adder({ label, taken, onAdd }: { label: string; taken: string[]; onAdd(name: string, parameter: ParameterDocument): void }) {
  const { t } = useTranslation();
  const [text, setText] = useState("");
  const [tried, setTried] = useState(false);
  const read = readParameter(text);
  const wrong = text === "" ? undefined : !NAME.test(read.name) ? t("diagram.badName") : isTaken(read.name, taken) ? t("diagram.takenName") : tried && !read.parameter ? t("diagram.noParameter") : undefined;
  return (
    <form
      onSubmit={(event) => {
        event.preventDefault();
        setTried(true);
        if (text === "" || wrong || !read.parameter) return;
        onAdd(read.name, read.parameter);
        setText("");
        setTried(false);
      }}
    >
      <TextInput label={label} value={text} onChange={(event) => setText(event.currentTarget.value)} error={wrong} placeholder="kp = 2.4k [1, 10k]" spellCheck={false} autoComplete="off" classNames={{ input: "numbers" }} />
    </form>
  );
}
