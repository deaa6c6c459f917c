import { BaseEdge, Position, type EdgeProps } from "@xyflow/react";

/** A signal that leads back: out to the right, below everything in between, and up to where it is compared. */
export function FeedbackEdge({ sourceX, sourceY, targetX, targetY, targetPosition, data, markerEnd, selected }: EdgeProps) {
  const below = Math.max(Number(data?.below ?? 0), sourceY + 24, targetY + 24);
  const out = sourceX + 16;
  const path = targetPosition === Position.Bottom ? `M${sourceX},${sourceY} H${out} V${below} H${targetX} V${targetY}` : `M${sourceX},${sourceY} H${out} V${below} H${targetX - 18} V${targetY} H${targetX}`;
  return <BaseEdge path={path} {...(markerEnd ? { markerEnd } : {})} interactionWidth={18} className={selected ? "selected" : ""} />;
}
