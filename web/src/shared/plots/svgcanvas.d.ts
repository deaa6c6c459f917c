declare module "svgcanvas/dist/svgcanvas.esm.js" {
  /** A canvas' context whose picture is an SVG document. */
  export const Context: new (width: number, height: number) => CanvasRenderingContext2D & { getSvg(): SVGSVGElement; getSerializedSvg(fixNamedEntities?: boolean): string };
}
