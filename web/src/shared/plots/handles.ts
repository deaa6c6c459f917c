import type uPlot from "uplot";
import type { Point, Zone, ZoneMoved } from "./types";

/** Pixels that an arrow key moves the edge of a zone. */
const STEP = 3;
/** ARIA knows no exponents: a gain of 0 dB that rounding has left at 6e-15 would be no value. */
const PLAIN = new Intl.NumberFormat("en", { useGrouping: false, maximumSignificantDigits: 6 });

/** The grips at the edges of zones: dragged with a pointer, or moved with the arrow keys. */
export class Handles {
  private readonly grips = new Map<string, HTMLElement>();
  private zones = new Map<string, Zone>();
  private taken: string | null = null;

  constructor(
    private readonly plot: uPlot,
    private readonly layer: HTMLElement,
    private readonly moved: ZoneMoved,
  ) {}

  /** While an edge is being dragged the axes stay as they are. */
  get held(): boolean {
    return this.taken !== null;
  }

  place(zones: Zone[]): void {
    this.zones = new Map(zones.filter((zone) => zone.handle).map((zone) => [zone.id, zone]));
    for (const [id, grip] of this.grips) {
      if (this.zones.has(id)) continue;
      grip.remove();
      this.grips.delete(id);
    }
    // Of the canvas, which lies exactly under the layer: asking for rectangles would make the browser lay out in every frame.
    const [left, top, width, height] = [this.plot.bbox.left, this.plot.bbox.top, this.plot.bbox.width, this.plot.bbox.height].map((pixels) => pixels / devicePixelRatio) as [number, number, number, number];
    for (const [id, { handle }] of this.zones) {
      const grip = this.grips.get(id) ?? this.made(id);
      const x = inside(this.plot.valToPos(handle!.at[0], "x"), width);
      const y = inside(this.plot.valToPos(handle!.at[1], "y"), height);
      grip.style.transform = `translate(${left + x}px, ${top + y}px)`;
      if (grip.getAttribute("aria-valuetext") !== handle!.text) {
        grip.setAttribute("aria-label", handle!.label);
        grip.setAttribute("aria-valuetext", handle!.text);
        grip.setAttribute("aria-valuenow", PLAIN.format(handle!.axis === "x" ? handle!.at[0] : handle!.at[1]));
        grip.title = handle!.text;
      }
    }
  }

  destroy(): void {
    for (const grip of this.grips.values()) grip.remove();
    this.grips.clear();
  }

  private made(id: string): HTMLElement {
    const grip = document.createElement("div");
    const axis = this.zones.get(id)!.handle!.axis;
    grip.className = "zone-grip";
    grip.tabIndex = 0;
    grip.dataset.zone = id;
    grip.dataset.axis = axis;
    grip.setAttribute("role", "slider");
    grip.setAttribute("aria-orientation", axis === "x" ? "horizontal" : "vertical");
    grip.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      grip.focus();
      grip.setPointerCapture(event.pointerId);
      this.taken = id;
    });
    grip.addEventListener("pointermove", (event) => this.taken === id && this.tell(id, this.at(event), false));
    const release = (event: PointerEvent) => {
      if (this.taken !== id) return;
      this.taken = null;
      this.tell(id, this.at(event), true);
    };
    grip.addEventListener("pointerup", release);
    grip.addEventListener("pointercancel", release);
    grip.addEventListener("keydown", (event) => {
      const way = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      const handle = this.zones.get(id)?.handle;
      if (!way || !handle) return;
      event.preventDefault();
      const size = STEP * (event.shiftKey ? 10 : 1);
      const x = this.plot.valToPos(handle.at[0], "x") + way[0]! * size;
      const y = this.plot.valToPos(handle.at[1], "y") + way[1]! * size;
      this.tell(id, [this.plot.posToVal(x, "x"), this.plot.posToVal(y, "y")], true);
    });
    this.layer.append(grip);
    this.grips.set(id, grip);
    return grip;
  }

  private at(event: PointerEvent): Point {
    const { left, top } = this.plot.over.getBoundingClientRect();
    return [this.plot.posToVal(event.clientX - left, "x"), this.plot.posToVal(event.clientY - top, "y")];
  }

  private tell(id: string, at: Point, done: boolean): void {
    this.moved(id, at, done);
  }
}

function inside(position: number, size: number): number {
  return Number.isFinite(position) ? Math.min(size, Math.max(0, position)) : size / 2;
}
