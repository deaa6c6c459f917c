import { useRef } from "react";
import classes from "./Knob.module.css";
import { keyPosition } from "./scale";

interface Props {
  /** 0..1 of its turn. */
  position: number;
  label: string;
  text: string;
  onMove(position: number): void;
  onCommit(): void;
  onReset(): void;
}

/** From where to where it turns, degrees from straight up. */
const TURN = 135;
/** Pixels of the pointer for the whole turn. */
const TRAVEL = 220;
const CENTRE = 24;

/** A parameter that is turned: dragged up or right, or moved with the keys of a slider. */
export function Knob({ position, label, text, onMove, onCommit, onReset }: Props) {
  const held = useRef<{ x: number; y: number; from: number } | null>(null);
  const angle = (-TURN + 2 * TURN * position) * (Math.PI / 180);
  const at = (radius: number, turn: number): string => `${(CENTRE + radius * Math.sin(turn)).toFixed(2)} ${(CENTRE - radius * Math.cos(turn)).toFixed(2)}`;
  const first = -TURN * (Math.PI / 180);
  const arc = (to: number) => `M${at(19, first)}A19 19 0 ${to - first > Math.PI ? 1 : 0} 1 ${at(19, to)}`;
  return (
    <svg
      className={classes.knob}
      viewBox="0 0 48 48"
      width={48}
      height={48}
      role="slider"
      tabIndex={0}
      aria-label={label}
      aria-valuemin={0}
      aria-valuemax={1}
      aria-valuenow={Number(position.toFixed(4))}
      aria-valuetext={text}
      onPointerDown={(event) => {
        event.currentTarget.setPointerCapture(event.pointerId);
        held.current = { x: event.clientX, y: event.clientY, from: position };
      }}
      onPointerMove={(event) => {
        const start = held.current;
        if (start) onMove(Math.min(1, Math.max(0, start.from + (event.clientX - start.x - event.clientY + start.y) / TRAVEL)));
      }}
      onPointerUp={() => {
        held.current = null;
        onCommit();
      }}
      onPointerCancel={() => {
        held.current = null;
        onCommit();
      }}
      onKeyDown={(event) => {
        const next = keyPosition(event.key, position, { shift: event.shiftKey, alt: event.altKey });
        if (next === null) return;
        event.preventDefault();
        onMove(next);
      }}
      onKeyUp={onCommit}
      onBlur={onCommit}
      onDoubleClick={onReset}
    >
      <path d={arc(-first)} className={classes.track} />
      <path d={arc(angle)} className={classes.value} />
      <circle cx={CENTRE} cy={CENTRE} r={14} className={classes.cap} />
      <path d={`M${at(5, angle)}L${at(13, angle)}`} className={classes.pointer} />
    </svg>
  );
}
