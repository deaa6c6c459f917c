import { Group, NativeSelect } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useTranslation } from "react-i18next";
import { datasetQuery, readyDatasets } from "@/shared/api/datasets";
import type { components } from "@/shared/api/schema";
import type { Scalar } from "@/shared/api/types";
import { ListEntry } from "@/shared/forms/SchemaFields";
import { NumberEntry } from "@/shared/ui/NumberEntry";
import { words } from "@/shared/units/format";
import type { Signal } from "./schema";

type Entry = components["schemas"]["SignalEntry"];
/** What the catalogue says of a parameter besides what the contract promises. */
type Parameter = Entry["parameters"][number] & { shape?: string; required?: boolean; choices?: string[] };

interface Props {
  signal: Signal;
  signals: Entry[];
  /** The field of the form that holds the signal. */
  at: string;
  faultAt(field: string): string | undefined;
  onChange(signal: Signal): void;
}

/** A command signal, its fields made from the catalogue; some are made of another one. */
export function SignalFields({ signal, signals, at, faultAt, onChange }: Props) {
  const { t } = useTranslation();
  const entry = signals.find(({ kind }) => kind === signal.kind);
  const put = (name: string, value: unknown) => onChange({ ...signal, [name]: value } as Signal);
  const recorded = signal.kind === "sampled" && ("dataset" in signal || "channel" in signal);
  const field = (parameter: Parameter) => {
    const { name, unit, doc, required } = parameter;
    const label = t(`optimise.ofSignal.${name}`, words(name));
    const fault = faultAt(`${at}.${name}`);
    const common = { label, title: doc, error: fault, withAsterisk: required ?? false };
    const standard = parameter.default === null || parameter.default === undefined ? undefined : String(parameter.default);
    if (parameter.shape === "signal") return <SignalFields key={name} signal={(signal[name] as Signal | undefined) ?? { kind: "step" }} signals={signals} at={`${at}.${name}`} faultAt={faultAt} onChange={(inner) => put(name, inner)} />;
    if (parameter.shape === "list") return <ListEntry key={name} {...common} value={signal[name]} unit={unit} placeholder="0; 1; 2" onChange={(list) => put(name, list)} w={200} />;
    if (parameter.choices) return <NativeSelect key={name} size="xs" {...common} value={String(signal[name] ?? standard ?? "")} data={parameter.choices} onChange={(event) => put(name, event.currentTarget.value)} />;
    return <NumberEntry key={name} {...common} value={signal[name] as Scalar | undefined} unit={unit} optional placeholder={standard} onCommit={(value) => put(name, value)} w={140} />;
  };
  const choose = (value: string) => {
    if (value === "recorded") return onChange({ kind: "sampled", dataset: "", channel: "" });
    const inner = signals.find(({ kind }) => kind === value)?.parameters.find((parameter: Parameter) => parameter.shape === "signal");
    onChange({ kind: value, ...(inner ? { [inner.name]: { kind: "step" } } : {}) });
  };
  return (
    <Group gap="sm" align="flex-start">
      <NativeSelect size="xs" label={t("optimise.signal")} title={entry?.equation} value={recorded ? "recorded" : signal.kind} data={[...signals.map(({ kind, title }) => ({ value: kind, label: t(`signals.${kind}`, title) })), { value: "recorded", label: t("optimise.recorded") }]} onChange={(event) => choose(event.currentTarget.value)} error={faultAt(`${at}.kind`)} />
      {recorded ? <Recorded signal={signal} at={at} faultAt={faultAt} onChange={onChange} /> : entry?.parameters.map((parameter) => field(parameter))}
    </Group>
  );
}

/** The channel of a recording as a command. */
function Recorded({ signal, at, faultAt, onChange }: Omit<Props, "signals">) {
  const { t } = useTranslation();
  const dataset = String(signal.dataset ?? "");
  const recordings = useQuery(readyDatasets);
  const chosen = useQuery({ ...datasetQuery(dataset), enabled: dataset !== "" });
  const none = { value: "", label: t("forms.choose") };
  return (
    <>
      <NativeSelect size="xs" label={t("optimise.recording")} value={dataset} data={[none, ...(recordings.data ?? []).map(({ id, name }) => ({ value: id, label: name }))]} error={faultAt(`${at}.dataset`)} onChange={(event) => onChange({ kind: "sampled", dataset: event.currentTarget.value, channel: "" })} />
      <NativeSelect size="xs" label={t("optimise.channel")} value={String(signal.channel ?? "")} data={[none, ...(chosen.data?.channels ?? []).map((channel) => ({ value: String(channel.name), label: String(channel.name) }))]} error={faultAt(`${at}.channel`)} onChange={(event) => onChange({ ...signal, channel: event.currentTarget.value })} />
    </>
  );
}
