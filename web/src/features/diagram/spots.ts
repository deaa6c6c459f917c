import type { Block, SystemDocument } from "@/shared/api/types";
import { portPlaces, sizeOf } from "./layout";
import { portsOf, type Catalogue, type End } from "./model";
import type { Point } from "./store";

const GAP = 50;
const GRID = 10;

/** Right of the block that a new one is connected to, so that the connection is straight. */
export function beside(from: End, document: SystemDocument, places: Record<string, Point> | undefined, catalogue: Catalogue, block: Block): Point {
  const source = document.blocks[from.block]!;
  const at = places?.[from.block] ?? { x: 60, y: 60 };
  const ports = portsOf(source, catalogue);
  const height = portPlaces(ports, source.kind, []).outputs[ports.outputs.indexOf(from.port)]?.y ?? 0;
  const own = portPlaces(portsOf(block, catalogue), block.kind, []).inputs[0]?.y ?? 0;
  return { x: at.x + sizeOf(ports, source.kind).width + GAP, y: at.y + height - own };
}

/** The wanted place, or the next one below where no other block is. */
export function freePlace(wanted: Point, document: SystemDocument, places: Record<string, Point> | undefined, catalogue: Catalogue, block: Block): Point {
  const size = sizeOf(portsOf(block, catalogue), block.kind);
  const point = { x: Math.round(wanted.x / GRID) * GRID, y: Math.round(wanted.y / GRID) * GRID };
  const others = Object.entries(document.blocks).flatMap(([name, other]) => (places?.[name] ? [{ ...places[name], ...sizeOf(portsOf(other, catalogue), other.kind) }] : []));
  const hits = () => others.find((other) => point.x < other.x + other.width + GRID && other.x < point.x + size.width + GRID && point.y < other.y + other.height + GRID && other.y < point.y + size.height + GRID);
  for (let other = hits(); other; other = hits()) point.y = Math.ceil((other.y + other.height + 2 * GRID) / GRID) * GRID;
  return point;
}
