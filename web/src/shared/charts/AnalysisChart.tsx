import { ActionIcon, Group, Menu, Text, useComputedColorScheme } from "@mantine/core";
import { useMemo, useRef } from "react";
import { useTranslation } from "react-i18next";
import { optionOf, type AnalysisSpec } from "./analysis";
import { csvOf, download, fileName, rasterised } from "@/shared/plots/export";
import { stroke } from "@/shared/plots/palette";
import classes from "@/shared/plots/Plot.module.css";
import { Chart } from "./Chart";
import { inks } from "./inks";

/** A chart of a result that stands still, with bands, bounds and marks, and its export as picture and table. */
export function AnalysisChart({ spec, height = 260, summary }: { spec: AnalysisSpec; height?: number; summary: string }) {
  const { t } = useTranslation();
  const dark = useComputedColorScheme("light") === "dark";
  const holder = useRef<HTMLElement>(null);
  const option = useMemo(() => optionOf(spec, dark), [spec, dark]);
  const drawn = () => holder.current?.querySelector<SVGElement>("[role=img] svg");
  const pixels = async () => {
    const svg = drawn();
    if (svg) download(fileName(spec.title, "png"), await rasterised(svg, inks(dark).paper));
  };
  const picture = () => {
    const svg = drawn();
    if (svg) download(fileName(spec.title, "svg"), new Blob([new XMLSerializer().serializeToString(svg)], { type: "image/svg+xml" }));
  };
  const table = () => csvOf({ x: spec.x, y: spec.y, series: spec.lines.map((line) => ({ label: line.label, color: "", dash: [] })) }, spec.lines);
  return (
    <section ref={holder} className={classes.frame} aria-label={spec.title}>
      <Group justify="space-between" wrap="nowrap" gap="xs" className={classes.head}>
        <Text component="h3" fw={600} fz="sm" truncate>
          {spec.title}
        </Text>
        <Menu position="bottom-end" withinPortal>
          <Menu.Target>
            <ActionIcon variant="subtle" color="gray" size="sm" aria-label={t("plot.export", { title: spec.title })}>
              ⋯
            </ActionIcon>
          </Menu.Target>
          <Menu.Dropdown>
            <Menu.Item onClick={() => void pixels()}>{t("plot.png")}</Menu.Item>
            <Menu.Item onClick={picture}>{t("plot.svg")}</Menu.Item>
            <Menu.Item onClick={() => download(fileName(spec.title, "csv"), new Blob([table()], { type: "text/csv" }))}>{t("plot.csv")}</Menu.Item>
          </Menu.Dropdown>
        </Menu>
      </Group>
      <Chart option={option} height={height} summary={summary} />
      {spec.lines.length > 1 && (
        <ul className={classes.legend}>
          {spec.lines.map((line, i) => {
            const { color, dash } = stroke(line.color ?? i, dark);
            return (
              <li key={line.label}>
                <svg width="26" height="8" aria-hidden>
                  {line.kind === "points" ? <circle cx="13" cy="4" r="3" fill={color} /> : <line x1="0" x2="26" y1="4" y2="4" stroke={color} strokeWidth="1.5" strokeDasharray={dash.join(" ")} />}
                </svg>
                {line.label}
              </li>
            );
          })}
        </ul>
      )}
    </section>
  );
}
