import { Group, NativeSelect, TextInput } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { toldElsewhere } from "@/shared/forms/faults";
import { NumberEntry } from "@/shared/ui/NumberEntry";
import { PlainEntry } from "@/shared/ui/PlainEntry";
import { needsOf, numberOf, type Goal } from "./schema";

interface Props {
  goal: Goal;
  number: number;
  unit: string;
  outputUnit: string;
  /** Whether its metric is one of a response: only these have outputs that settle. */
  inTime: boolean;
  at: string;
  faultAt(field: string): string | undefined;
  onChange(own: Partial<Goal>): void;
}

/** What else can be said of a goal: a value to be hit, how strictly its bounds hold, what it weighs, a curve that it is held against. */
export function GoalMore({ goal, number, unit, outputUnit, inTime, at, faultAt, onChange }: Props) {
  const { t } = useTranslation();
  const needs = needsOf(goal.metric);
  const own = numberOf(goal.metric);
  const wrong = (field: string) => toldElsewhere(faultAt(`${at}.${field}`));
  const curve = (field: "upperCurve" | "lowerCurve" | "reference", example: string) => (
    <TextInput size="xs" label={t(`optimise.${field}`)} aria-label={t(`optimise.${field}Of`, { number })} title={t(needs === "magnitude" ? "optimise.curveOverFrequency" : "optimise.curveOverTime")} value={goal[field] ?? ""} placeholder={example} {...wrong(field)} spellCheck={false} onChange={(event) => onChange({ [field]: event.currentTarget.value || undefined })} w={270} />
  );
  const number_ = (key: 0 | 1) => (
    <NumberEntry label={t(key === 0 ? "optimise.bandFrom" : "optimise.bandTo")} aria-label={t(key === 0 ? "optimise.bandFromOf" : "optimise.bandToOf", { number })} value={goal.band?.[key]} unit="rad/s" optional {...wrong("band")} onCommit={(value) => onChange({ band: key === 0 ? [value, goal.band?.[1]] : [goal.band?.[0], value] })} w={130} />
  );
  return (
    <Group gap="sm" align="flex-start" pl="md">
      {needs === "band" && (
        <>
          {number_(0)}
          {number_(1)}
        </>
      )}
      {own && <NumberEntry label={t(`optimise.${own.field}`)} aria-label={t(`optimise.${own.field}Of`, { number })} value={goal.number} unit={own.unit || outputUnit} optional placeholder={own.example} {...wrong("number")} onCommit={(given) => onChange({ number: given })} w={170} />}
      {needs === "reference" && curve("reference", "0: 0; 200 ms: 1; 2: 1")}
      {needs === "envelope" && (
        <>
          {curve("upperCurve", "0: 1.1; 1: 1.1; 1: 1.02; 5: 1.02")}
          {curve("lowerCurve", "0.5: 0.9; 5: 0.98")}
          <NumberEntry label={t("optimise.curveScale")} aria-label={t("optimise.curveScaleOf", { number })} title={t("optimise.curveScaleDoc")} value={goal.curveScale} unit={outputUnit} optional {...wrong("curveScale")} onCommit={(curveScale) => onChange({ curveScale })} w={120} />
        </>
      )}
      {needs === "magnitude" && (
        <>
          {curve("upperCurve", "0.1: 0.01; 10: 2; 100: 2")}
          {curve("lowerCurve", "1 0.2 / 1 3 2")}
        </>
      )}
      <NumberEntry label={t("optimise.target")} aria-label={t("optimise.targetOf", { number })} value={goal.target} unit={unit} optional {...wrong("target")} onCommit={(target) => onChange({ target })} w={130} />
      <NumberEntry label={t("optimise.tolerance")} aria-label={t("optimise.toleranceOf", { number })} value={goal.tolerance} unit={unit} optional placeholder="1 %" {...wrong("tolerance")} onCommit={(tolerance) => onChange({ tolerance })} w={120} />
      <NativeSelect
        size="xs"
        label={t("optimise.strict")}
        aria-label={t("optimise.strictOf", { number })}
        value={goal.soft ? "soft" : "hard"}
        data={[
          { value: "hard", label: t("optimise.hard") },
          { value: "soft", label: t("optimise.soft") },
        ]}
        {...wrong("soft")}
        onChange={(event) => onChange({ soft: event.currentTarget.value === "soft" })}
      />
      {inTime && (
        <NativeSelect
          size="xs"
          label={t("optimise.unsettled")}
          aria-label={t("optimise.unsettledOf", { number })}
          title={t("optimise.unsettledDoc")}
          value={goal.settled ? "refused" : "taken"}
          data={[
            { value: "taken", label: t("optimise.unsettledTaken") },
            { value: "refused", label: t("optimise.unsettledRefused") },
          ]}
          {...wrong("settled")}
          onChange={(event) => onChange({ settled: event.currentTarget.value === "refused" })}
        />
      )}
      <PlainEntry label={t("optimise.weight")} aria-label={t("optimise.weightOf", { number })} value={goal.weight} optional placeholder="1" {...wrong("weight")} onCommit={(weight) => onChange({ weight })} w={90} />
    </Group>
  );
}
