import type { ECharts } from "echarts/core";
import type { EChartsCoreOption } from "echarts/core";
import { useEffect, useRef } from "react";

interface Props {
  option: EChartsCoreOption;
  height: number;
  /** What the picture says; what can be done in it must be possible in a table, too. */
  summary: string;
  /** A datum was clicked: the name of its series, and its number there. */
  onPick?: (series: string, index: number) => void;
}

/** A chart for analysis. The library comes when the first one is looked at. */
export function Chart({ option, height, summary, onPick }: Props) {
  const holder = useRef<HTMLDivElement>(null);
  const chart = useRef<ECharts | null>(null);
  const latest = useRef({ option, onPick });
  latest.current = { option, onPick };
  useEffect(() => {
    let gone = false;
    let observer: ResizeObserver | undefined;
    void import("./echarts").then(({ init }) => {
      if (gone || !holder.current) return;
      const made = init(holder.current, null, { renderer: "svg" });
      chart.current = made;
      made.setOption({ animation: false, ...latest.current.option });
      made.on("click", (event) => latest.current.onPick?.(String(event.seriesName ?? ""), event.dataIndex));
      observer = new ResizeObserver(() => made.resize());
      observer.observe(holder.current);
    });
    return () => {
      gone = true;
      observer?.disconnect();
      chart.current?.dispose();
      chart.current = null;
    };
  }, []);
  useEffect(() => chart.current?.setOption({ animation: false, ...option }, { notMerge: true }), [option]);
  return <div ref={holder} role="img" aria-label={summary} style={{ width: "100%", height }} />;
}
