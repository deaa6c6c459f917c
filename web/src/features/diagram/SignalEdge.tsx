import { BaseEdge, getSmoothStepPath, Position, type Edge, type EdgeProps } from "@xyflow/react";
import { memo } from "react";
import type { Point, Route } from "./store";

export type SignalData = {
  /** The signal that travels here, as the document names it. */
  from: string;
  route: Route | undefined;
  /** Leads back: how far below everything in between it runs. */
  below: number | undefined;
};
export type SignalEdgeType = Edge<SignalData, "signal">;

const CORNER = 5;
/** Half a port, and a little more: a route ends at the border of its block, the port's outer edge lies beyond. */
const NEAR = 8;

/** A signal: along its route while its ends are where the layout put them; otherwise straight on, or back below everything. */
export const SignalEdge = memo(function SignalEdge({ sourceX, sourceY, targetX, targetY, sourcePosition, targetPosition, data, markerEnd, selected, style }: EdgeProps<SignalEdgeType>) {
  const route = data?.route;
  const near = (point: Point | undefined, x: number, y: number) => point !== undefined && Math.abs(point.x - x) <= NEAR && Math.abs(point.y - y) <= NEAR;
  const path =
    route && near(route[0], sourceX, sourceY) && near(route.at(-1), targetX, targetY)
      ? rounded(route)
      : data?.below !== undefined
        ? rounded(around(sourceX, sourceY, targetX, targetY, Math.max(data.below, sourceY + 24, targetY + 24), targetPosition))
        : getSmoothStepPath({ sourceX, sourceY, sourcePosition, targetX, targetY, targetPosition, borderRadius: CORNER })[0];
  return <BaseEdge path={path} {...(markerEnd ? { markerEnd } : {})} {...(style ? { style } : {})} interactionWidth={18} className={selected ? "selected" : ""} />;
});

function around(sourceX: number, sourceY: number, targetX: number, targetY: number, below: number, side: Position): Point[] {
  const out = sourceX + 16;
  const start = [{ x: sourceX, y: sourceY }, { x: out, y: sourceY }, { x: out, y: below }];
  if (side === Position.Bottom) return [...start, { x: targetX, y: below }, { x: targetX, y: targetY }];
  return [...start, { x: targetX - 18, y: below }, { x: targetX - 18, y: targetY }, { x: targetX, y: targetY }];
}

function rounded(points: readonly Point[]): string {
  const [first, ...rest] = points as [Point, ...Point[]];
  let path = `M${first.x},${first.y}`;
  rest.forEach((point, i) => {
    const before = points[i]!;
    const after = rest[i + 1];
    if (!after) path += `L${point.x},${point.y}`;
    else {
      const [a, b] = [towards(point, before), towards(point, after)];
      path += `L${a.x},${a.y}Q${point.x},${point.y} ${b.x},${b.y}`;
    }
  });
  return path;
}

function towards(from: Point, to: Point): Point {
  const far = Math.hypot(to.x - from.x, to.y - from.y);
  const share = far === 0 ? 0 : Math.min(CORNER / far, 0.5);
  return { x: from.x + (to.x - from.x) * share, y: from.y + (to.y - from.y) * share };
}
