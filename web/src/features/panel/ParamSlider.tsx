import { ActionIcon, Group, Text, Tooltip } from "@mantine/core";
import { memo, useEffect, useState } from "react";
import { useTranslation } from "react-i18next";
import type { LiveParameter } from "@/shared/live/protocol";
import { NumberEntry } from "@/shared/ui/NumberEntry";
import { prettyUnit, withUnit } from "@/shared/units/format";
import classes from "./ParamSlider.module.css";
import { fromPosition, keyPosition, toPosition, travelOf } from "./scale";

interface Props {
  parameter: LiveParameter;
  value: number;
  /** Elasticity of the chosen metric, as a part of the largest one; drawn behind the label. */
  influence: { part: number; value: number } | null;
  metric: string;
  onMove(path: string, value: number): void;
  onCommit(path: string, value: number): void;
  onRemove(path: string): void;
}

/** One parameter: label with its influence, slider, typed entry. Moving it does not pass through the page's state. */
export const ParamSlider = memo(function ParamSlider({ parameter, value, influence, metric, onMove, onCommit, onRemove }: Props) {
  const { t } = useTranslation();
  const [shown, setShown] = useState(value);
  useEffect(() => setShown(value), [value]);
  const travel = travelOf(parameter);
  const { path, unit } = parameter;
  const move = (next: number) => {
    setShown(next);
    onMove(path, next);
  };
  const commit = (next: number) => {
    move(next);
    onCommit(path, next);
  };
  return (
    <div className={classes.slider}>
      <Group justify="space-between" wrap="nowrap" gap={4} className={classes.label}>
        {influence && (
          <Tooltip label={t("panel.elasticity", { metric, value: influence.value.toFixed(2) })}>
            <span className={classes.bar} data-sign={influence.value < 0 ? "minus" : "plus"} style={{ width: `${Math.round(100 * Math.abs(influence.part))}%` }} />
          </Tooltip>
        )}
        <Tooltip label={parameter.doc} disabled={!parameter.doc} openDelay={400}>
          <Text span fz="xs" fw={500} truncate className={classes.name}>
            {path}
          </Text>
        </Tooltip>
        <Group gap={0} wrap="nowrap" className={classes.name}>
          <Text span fz="xs" c="dimmed" className="numbers" aria-hidden>
            {prettyUnit(unit) ? `[${prettyUnit(unit)}]` : ""}
          </Text>
          <ActionIcon size="xs" variant="transparent" color="gray" aria-label={t("panel.reset", { path })} title={t("panel.reset", { path })} onClick={() => commit(parameter.value)} disabled={shown === parameter.value}>
            ↺
          </ActionIcon>
          <ActionIcon size="xs" variant="transparent" color="gray" aria-label={t("panel.remove", { path })} title={t("panel.remove", { path })} onClick={() => onRemove(path)}>
            ×
          </ActionIcon>
        </Group>
      </Group>
      <div className={classes.row}>
        <input
          type="range"
          className="slider"
          min={0}
          max={1}
          step={0.0005}
          value={toPosition(shown, travel)}
          aria-label={path}
          aria-valuetext={withUnit(shown, unit)}
          onChange={(event) => move(fromPosition(Number(event.currentTarget.value), travel))}
          onPointerUp={() => onCommit(path, shown)}
          onKeyDown={(event) => {
            const next = keyPosition(event.key, toPosition(shown, travel), { shift: event.shiftKey, alt: event.altKey });
            if (next === null) return;
            event.preventDefault();
            move(fromPosition(next, travel));
          }}
          onKeyUp={() => onCommit(path, shown)}
          onBlur={() => onCommit(path, shown)}
          onDoubleClick={() => commit(parameter.value)}
        />
        <NumberEntry
          aria-label={t("panel.valueOf", { path })}
          value={Number(shown.toPrecision(6))}
          onCommit={(entered) => typeof entered === "number" && commit(clampedTo(entered, parameter))}
          w={104}
          size="xs"
        />
      </div>
    </div>
  );
});

/** A typed value may leave the slider's travel, but not what is physically possible. */
function clampedTo(value: number, { lower, upper }: LiveParameter): number {
  return Math.min(upper ?? Infinity, Math.max(lower ?? -Infinity, value));
}
