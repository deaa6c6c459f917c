/** Viridis, thinned: light means much in every theme, and everybody sees the order. */
export const SEQUENTIAL = ["#440154", "#414487", "#2a788e", "#22a884", "#7ad151", "#fde725"];

/** Colours of what surrounds the data. */
export function inks(dark: boolean): { ink: string; grid: string; paper: string; accent: string; mark: string; faint: string } {
  return dark ? { ink: "#d6dade", grid: "#3a3f45", paper: "#1f2225", accent: "#6cb8ec", mark: "#ff9d5c", faint: "#7d858c" } : { ink: "#24292e", grid: "#e4e7ea", paper: "#ffffff", accent: "#0b5c8f", mark: "#b84a00", faint: "#9aa1a8" };
}

/** An axis of values, with its name along it. */
export function axisOf(name: string, dark: boolean, more: object = {}): object {
  const { ink, grid } = inks(dark);
  return { name, nameLocation: "middle", nameGap: 32, scale: true, nameTextStyle: { color: ink }, axisLabel: { color: ink }, axisLine: { lineStyle: { color: ink } }, splitLine: { lineStyle: { color: grid } }, ...more };
}
