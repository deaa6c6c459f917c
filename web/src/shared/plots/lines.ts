import type { Numbers } from "./types";

/** What a line is written to: a canvas' own path, or one that is kept. */
export interface Pen {
  moveTo(x: number, y: number): void;
  lineTo(x: number, y: number): void;
}

/**
 * A polyline with as few corners as its picture needs; at every point that is left out it is at most `tolerance` pixels above or below
 * the corner that was there. What is no number interrupts it.
 *
 * From each corner the line may go on as long as one slope passes all points since then within the tolerance:
 * max (y_i - e - y_0)/(x_i - x_0) <= slope <= min (y_i + e - y_0)/(x_i - x_0). Where x does not advance every point is a corner.
 * A thousand points of a smooth curve become some fifty corners, which is what a slow painter's time goes by.
 */
export function drawLine(pen: Pen, x: Numbers, y: Numbers, tolerance: number): void {
  let down = false;
  let waiting = false;
  let x0 = 0;
  let y0 = 0;
  let lastX = 0;
  let lastY = 0;
  let low = -Infinity;
  let high = Infinity;
  const corner = (px: number, py: number) => {
    x0 = px;
    y0 = py;
    low = -Infinity;
    high = Infinity;
  };
  for (let i = 0; i < x.length; i++) {
    const px = x[i]!;
    const py = y[i]!;
    if (!Number.isFinite(px + py)) {
      if (waiting) pen.lineTo(lastX, lastY);
      down = waiting = false;
      continue;
    }
    if (!down) {
      pen.moveTo(px, py);
      corner(px, py);
      down = true;
      continue;
    }
    let dx = px - x0;
    let slope = (py - y0) / dx;
    if (waiting && !(dx > 0 && slope >= low && slope <= high && px > lastX)) {
      pen.lineTo(lastX, lastY);
      corner(lastX, lastY);
      dx = px - x0;
      slope = (py - y0) / dx;
    }
    if (dx > 0) {
      low = Math.max(low, (py - tolerance - y0) / dx);
      high = Math.min(high, (py + tolerance - y0) / dx);
      lastX = px;
      lastY = py;
      waiting = true;
    } else {
      pen.lineTo(px, py);
      corner(px, py);
      waiting = false;
    }
  }
  if (waiting) pen.lineTo(lastX, lastY);
}

/** A curve in the plane, without the points that lie within `tolerance` pixels of the one before; what is no number interrupts it. */
export function drawPath(pen: Pen, x: Numbers, y: Numbers, tolerance: number): void {
  let down = false;
  let lastX = 0;
  let lastY = 0;
  for (let i = 0; i < x.length; i++) {
    const px = x[i]!;
    const py = y[i]!;
    if (!Number.isFinite(px + py)) {
      down = false;
      continue;
    }
    if (!down) pen.moveTo(px, py);
    else if (Math.abs(px - lastX) + Math.abs(py - lastY) > tolerance || i === x.length - 1) pen.lineTo(px, py);
    else continue;
    lastX = px;
    lastY = py;
    down = true;
  }
}
