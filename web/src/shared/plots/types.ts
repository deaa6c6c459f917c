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
  /** Lowest and highest y that matters, whatever the curves do. */
  clamp?: [number, number];
  /** Vertical and horizontal lines to be compared with. */
  lines?: { x?: number; y?: number }[];
  /** Points of the plane that must be in sight, the critical point say. */
  keep?: [number, number][];
  /** Regions where no curve should come. */
  zones?: { x: [number, number]; y: [number, number] }[];
}

export interface Curve {
  x: Numbers;
  y: Numbers;
}

/** What a page knows of a plot, whichever library draws it. */
export interface LivePlot {
  update(curves: Curve[]): void;
  png(): Promise<Blob>;
  destroy(): void;
}
