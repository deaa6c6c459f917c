import { ActionIcon, CloseButton, Group, Menu, Text } from "@mantine/core";
import { memo, useEffect, useImperativeHandle, useRef, useState, type Ref } from "react";
import { useTranslation } from "react-i18next";
import { csvOf, download, fileName } from "./export";
import classes from "./Plot.module.css";
import type { Curve, Decor, LivePlot, PlotSpec, ZoneMoved } from "./types";
import { createUPlot } from "./uplot";

export interface PlotHandle {
  /** Draws at once, without React: what a slider drags. */
  update(curves: Curve[], decor?: Decor): void;
}

interface Props {
  spec: PlotSpec;
  curves?: Curve[];
  height?: number;
  /** Rows that it takes of the grid it stands in. */
  rows?: number;
  /** What the picture says, for those who cannot see it. */
  summary: string;
  /** How many of the faint series are drawn, and what takes them away. */
  shadows?: number;
  onDropShadows?(): void;
  /** The edge of a zone was dragged. */
  onZone?: ZoneMoved;
  ref?: Ref<PlotHandle>;
  /** A stretch of x was marked with the mouse: the page fetches it in its own detail. Without it, the picture itself is stretched. */
  onZoom?: (from: number, to: number) => void;
}

/** A plot with its legend, the value under the cursor, and its export as picture and table. */
export const Plot = memo(function Plot({ spec, curves, height = 280, rows = 1, summary, shadows = 0, onDropShadows, onZone, ref, onZoom }: Props) {
  const { t } = useTranslation();
  const holder = useRef<HTMLDivElement>(null);
  const layer = useRef<HTMLDivElement>(null);
  const moved = useRef(onZone);
  moved.current = onZone;
  const readout = useRef<HTMLParagraphElement>(null);
  const plot = useRef<LivePlot | null>(null);
  const shown = useRef<Curve[]>(curves ?? []);
  const behind = useRef<Decor | undefined>(undefined);
  /** What the picture shows: of other series the curves are still to come. */
  const drawn = useRef({ spec, curves: shown.current });
  /** Before the first curves there is nothing to export. */
  const [empty, setEmpty] = useState(true);

  const zoom = useRef(onZoom);
  zoom.current = onZoom;
  const zooms = onZoom !== undefined;
  useEffect(() => {
    const told = zooms ? (from: number, to: number) => zoom.current?.(from, to) : undefined;
    const made = createUPlot(
      holder.current!,
      spec,
      (text) => {
        if (readout.current) readout.current.textContent = text;
      },
      { layer: layer.current!, moved: (...told) => moved.current?.(...told) },
      told,
    );
    plot.current = made;
    if (shown.current.length === spec.series.length) made.update(shown.current, behind.current);
    return () => {
      plot.current = null;
      made.destroy();
    };
  }, [spec, zooms]);

  const update = (next: Curve[], decor?: Decor) => {
    shown.current = next;
    behind.current = decor;
    holder.current?.removeAttribute("data-waiting");
    if (next.length !== spec.series.length) return;
    drawn.current = { spec, curves: next };
    if (empty) setEmpty(false);
    plot.current?.update(next, decor);
  };
  useImperativeHandle(ref, () => ({ update }));
  useEffect(() => {
    if (curves) update(curves);
  });

  // One curve needs no name beside the title; an earlier setting that is drawn has one.
  const named = [...spec.series.filter((s) => !s.faint), ...spec.series.filter((s) => s.faint).slice(0, shadows)];
  return (
    <section className={classes.frame} aria-label={spec.title} data-tall={rows > 1 || undefined} style={rows > 1 ? { gridRow: `span ${rows}` } : undefined}>
      <Group justify="space-between" wrap="nowrap" gap="xs" className={classes.head}>
        <Text component="h3" fw={600} fz="sm" truncate>
          {spec.title}
        </Text>
        <Group gap={6} wrap="nowrap">
          <Text ref={readout} span fz="xs" c="dimmed" className="numbers" />
          <Menu position="bottom-end" withinPortal>
            <Menu.Target>
              <ActionIcon variant="subtle" color="gray" size="sm" disabled={empty} aria-label={t("plot.export", { title: spec.title })}>
                ⋯
              </ActionIcon>
            </Menu.Target>
            <Menu.Dropdown>
              <Menu.Item onClick={async () => plot.current && download(fileName(spec.title, "png"), await plot.current.png())}>{t("plot.png")}</Menu.Item>
              <Menu.Item onClick={async () => plot.current && download(fileName(spec.title, "svg"), await plot.current.svg())}>{t("plot.svg")}</Menu.Item>
              <Menu.Item onClick={() => download(fileName(spec.title, "csv"), new Blob([csvOf(drawn.current.spec, drawn.current.curves)], { type: "text/csv" }))}>{t("plot.csv")}</Menu.Item>
            </Menu.Dropdown>
          </Menu>
        </Group>
      </Group>
      <div className={classes.plot}>
        <div ref={holder} role="img" aria-label={summary} data-waiting={curves === undefined || undefined} style={{ height }} className={classes.canvas} />
        <div ref={layer} className={classes.grips} />
      </div>
      <div className={classes.legend}>
        {named.length > 1 && (
          <ul>
            {named.map((s, i) => (
              <li key={i}>
                <svg width="26" height="8" aria-hidden>
                  {s.marks ? <path d="M9 0l8 8M17 0l-8 8" stroke={s.color} strokeWidth="1.500" /> : <line x1="0" x2="26" y1="4" y2="4" stroke={s.color} strokeWidth={s.width ?? 1.5} strokeDasharray={s.dash.join(" ")} />}
                </svg>
                {s.label}
              </li>
            ))}
          </ul>
        )}
        {shadows > 0 && <CloseButton size={24} iconSize={12} aria-label={t("plot.dropShadows")} title={t("plot.dropShadows")} onClick={onDropShadows} />}
      </div>
    </section>
  );
});
