import { ActionIcon, Group, Menu, Text, Tooltip } from "@mantine/core";
import { memo, useCallback, useEffect, useLayoutEffect, useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import type { LiveParameter } from "@/shared/live/protocol";
import { PlainEntry } from "@/shared/ui/PlainEntry";
import { prettyUnit, withUnit } from "@/shared/units/format";
import { Knob } from "./Knob";
import classes from "./ParamSlider.module.css";
import { fromPosition, keyPosition, toPosition, travelOf, type Scale } from "./scale";

/** Elasticity of the chosen metric, as a part of the largest one; drawn behind the label. */
export interface Influence {
  part: number;
  value: number;
}

interface Props {
  parameter: LiveParameter;
  value: number;
  influence: Influence | null;
  metric: string;
  knob: boolean;
  scale: Scale | undefined;
  onMove(path: string, value: number): void;
  onCommit(path: string, value: number): void;
  onRemove(path: string): void;
  onKnob(path: string, knob: boolean): void;
  /** Draws the root locus of the parameter, or takes it away; left out where there is none. */
  onLocus?: ((path: string) => void) | undefined;
  locus?: boolean;
  /** Curves over frequency are pulled by this parameter. */
  pull?: boolean;
  onPull?: ((path: string) => void) | undefined;
  onScale(path: string, scale: Scale): void;
}

/** One parameter: label with its influence, slider or knob, typed entry. Moving it does not pass through the page's state. */
export const ParamSlider = memo(function ParamSlider({ parameter, value, influence, metric, knob, scale, locus = false, pull = false, onPull, onMove, onCommit, onRemove, onKnob, onLocus, onScale }: Props) {
  const { t } = useTranslation();
  const [rests, setRests] = useState(value);
  const [moved, setMoved] = useState(value !== parameter.value);
  const moving = useRef(value);
  const held = useRef(false);
  const slider = useRef<HTMLInputElement>(null);
  const entry = useRef<HTMLInputElement>(null);
  const travel = travelOf(parameter, scale);
  const { path, unit } = parameter;
  /** A value that moves is written where it stands: drawing anew what a slider is made of would cost more than the curves. */
  const write = (next: number) => {
    moving.current = next;
    const input = slider.current;
    if (!input) return;
    const at = toPosition(next, travel);
    input.value = String(at);
    input.style.setProperty("--at", `${(100 * at).toFixed(2)}%`);
    input.setAttribute("aria-valuetext", withUnit(next, unit));
  };
  const move = (next: number) => {
    held.current = true;
    write(next);
    entry.current!.value = String(rounded(next));
    if (knob) setRests(next);
    setMoved(next !== parameter.value);
    onMove(path, next);
  };
  const settle = () => {
    held.current = false;
    setRests(moving.current);
    onCommit(path, moving.current);
  };
  const commit = (next: number) => {
    move(next);
    settle();
  };
  const latest = useRef(commit);
  latest.current = commit;
  const reset = useCallback(() => latest.current(parameter.value), [parameter]);
  // What is given or drawn meanwhile does not take the slider out of a hand.
  useEffect(() => {
    if (held.current) return;
    setRests(value);
    setMoved(value !== parameter.value);
  }, [value, parameter]);
  useLayoutEffect(() => write(held.current ? moving.current : rests), [rests, knob, scale, parameter]);
  return (
    <div className={classes.slider}>
      <Head parameter={parameter} influence={influence} metric={metric} knob={knob} log={travel.log} canLog={travel.low > 0} moved={moved} onReset={reset} onRemove={onRemove} onKnob={onKnob} locus={locus} onLocus={onLocus} pull={pull} onPull={onPull} onScale={onScale} />
      <div className={classes.row}>
        {knob ? (
          <Knob position={toPosition(rests, travel)} label={path} text={withUnit(rests, unit)} onMove={(next) => move(fromPosition(next, travel))} onCommit={settle} onReset={reset} />
        ) : (
          <input
            ref={slider}
            type="range"
            className="slider"
            min={0}
            max={1}
            step={0.0005}
            defaultValue={toPosition(rests, travel)}
            aria-label={path}
            onChange={(event) => move(fromPosition(Number(event.currentTarget.value), travel))}
            onPointerUp={settle}
            onKeyDown={(event) => {
              const next = keyPosition(event.key, toPosition(moving.current, travel), { shift: event.shiftKey, alt: event.altKey });
              if (next === null) return;
              event.preventDefault();
              move(fromPosition(next, travel));
            }}
            onKeyUp={settle}
            onBlur={settle}
            onDoubleClick={reset}
          />
        )}
        <PlainEntry ref={entry} aria-label={t("panel.valueOf", { path })} value={rounded(rests)} unit={unit} onCommit={(entered) => entered !== undefined && commit(clampedTo(entered, parameter))} w={prettyUnit(unit).length > LONG ? 158 : 118} size="xs" />
      </div>
    </div>
  );
});

interface HeadProps {
  parameter: LiveParameter;
  influence: Influence | null;
  metric: string;
  knob: boolean;
  log: boolean;
  canLog: boolean;
  locus: boolean;
  onLocus: ((path: string) => void) | undefined;
  pull: boolean;
  onPull: ((path: string) => void) | undefined;
  moved: boolean;
  onReset(): void;
  onRemove(path: string): void;
  onKnob(path: string, knob: boolean): void;
  onScale(path: string, scale: Scale): void;
}

/** A unit of more characters would leave no room for the number. */
const LONG = 6;

/** What does not change while the slider moves: it is not rendered then. */
const Head = memo(function Head({ parameter: { path, doc }, influence, metric, knob, log, canLog, moved, locus, pull, onReset, onRemove, onKnob, onLocus, onPull, onScale }: HeadProps) {
  const { t } = useTranslation();
  return (
    <Group justify="space-between" wrap="nowrap" gap={4} className={classes.label}>
      {influence && (
        <Tooltip label={t("panel.elasticity", { metric, value: influence.value.toFixed(2) })}>
          <span className={classes.bar} data-sign={influence.value < 0 ? "minus" : "plus"} style={{ width: `${Math.round(100 * Math.abs(influence.part))}%` }} />
        </Tooltip>
      )}
      <Tooltip label={doc} disabled={!doc} openDelay={400}>
        <Text span fz="xs" fw={500} truncate className={classes.name}>
          {path}
        </Text>
      </Tooltip>
      <Group gap={0} wrap="nowrap" className={classes.name}>
        <Text span fz="xs" c="dimmed" className="numbers" aria-hidden>
          {log ? "log" : ""}
        </Text>
        <ActionIcon size="xs" variant="transparent" color="gray" aria-label={t("panel.reset", { path })} title={t("panel.reset", { path })} onClick={onReset} disabled={!moved}>
          ↺
        </ActionIcon>
        <Menu position="bottom-end" withinPortal>
          <Menu.Target>
            <ActionIcon size="xs" variant="transparent" color="gray" aria-label={t("panel.more", { path })}>
              ⋮
            </ActionIcon>
          </Menu.Target>
          <Menu.Dropdown>
            <Menu.Item onClick={() => onKnob(path, !knob)}>{t(knob ? "panel.asSlider" : "panel.asKnob")}</Menu.Item>
            <Menu.Item onClick={() => onScale(path, log ? "linear" : "log")} disabled={!log && !canLog}>
              {t(log ? "panel.linear" : "panel.logarithmic")}
            </Menu.Item>
            {onLocus && <Menu.Item onClick={() => onLocus(path)}>{t(locus ? "panel.noLocus" : "panel.asLocus")}</Menu.Item>}
            {onPull && (
              <Menu.Item onClick={() => onPull(path)} disabled={pull}>
                {t("panel.asPull")}
              </Menu.Item>
            )}
            <Menu.Item onClick={() => onRemove(path)}>{t("panel.remove", { path })}</Menu.Item>
          </Menu.Dropdown>
        </Menu>
      </Group>
    </Group>
  );
});

const rounded = (value: number): number => Number(value.toPrecision(6));

/** A typed value may leave the slider's travel, but not what is physically possible. */
function clampedTo(value: number, { lower, upper }: LiveParameter): number {
  return Math.min(upper ?? Infinity, Math.max(lower ?? -Infinity, value));
}
