export type Numbers = Float32Array | Float64Array | number[];

export interface Axis {
  label: string;
  unit: string;
  log?: boolean;
}

export interface Series {
  label: string;
  color: string;
  dash: number[];
  width?: number;
  /** Drawn as marks instead of a line (poles, measured points). */
  marks?: "cross" | "circle";
  /** Earlier settings, the reference: seen, but behind. */
  faint?: boolean;
}

export interface PlotSpec {
  title: string;
  x: Axis;
  y: Axis;
  series: Series[];
  dark: boolean;
  /** Same pixels per unit on both axes: Nyquist diagrams, pole maps. */
  equal?: boolean;
  /** Each curve has its own x, as in a plane, but the axes have units of their own: Nichols charts. */
  free?: boolean;
  /** Lowest and highest y that matters, whatever the curves do. */
  clamp?: [number, number];
  /** The most of y that is shown, from the highest value down: spectra. */
  span?: number;
  /** Vertical and horizontal lines to be compared with. */
  lines?: { x?: number; y?: number }[];
  /** Points of the plane that must be in sight, the critical point say. */
  keep?: [number, number][];
  /** Lowest and highest x of curves that have their own; that of y where it is left out. */
  clampX?: [number, number];
  /** Lines of a chart behind the curves, for the ranges that are seen. */
  chart?: (x: [number, number], y: [number, number]) => ChartLine[];
  /** A circle about the origin: where a loop's gain is 1. */
  circle?: number;
}

/** A line of a chart, with what it stands for written at one of its points. */
export interface ChartLine extends Curve {
  text: string;
  at: Point;
}

export type Point = [number, number];

/** A region where no curve should come; infinite ends reach to the edge of the plot. */
export type Shape =
  | { kind: "box"; x: [number, number]; y: [number, number] }
  | { kind: "disc"; center: Point; radius: number }
  /** Everything right of both rays from the origin that meet the negative real axis at `angle`, rad. */
  | { kind: "outside-wedge"; angle: number };

export interface Zone {
  id: string;
  shapes: Shape[];
  /** Where its edge can be taken; without one it only lies there. */
  handle?: { at: Point; axis: "x" | "y" | "both"; label: string; text: string };
}

/** A distance that is read off a curve: a margin. */
export interface Mark {
  from: Point;
  to: Point;
  text: string;
}

/** Between two curves over the same x: the error band of a measurement. */
export interface Band {
  x: Numbers;
  low: Numbers;
  high: Numbers;
  color: string;
}

/** What lies behind and beside the curves, and may change with each of them. */
export interface Decor {
  zones: Zone[];
  marks: Mark[];
  bands: Band[];
}

export const NOTHING: Decor = { zones: [], marks: [], bands: [] };

/** The edge of a zone was taken to a point of the plane; `done` when it was let go. */
export type ZoneMoved = (id: string, at: Point, done: boolean) => void;

export interface Curve {
  x: Numbers;
  y: Numbers;
}

/** What a page knows of a plot, whichever library draws it. */
export interface LivePlot {
  update(curves: Curve[], decor?: Decor): void;
  png(): Promise<Blob>;
  svg(): Promise<Blob>;
  destroy(): void;
}
