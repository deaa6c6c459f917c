/** Okabe and Ito's colours, told apart by everybody, darkened for light paper (on which their yellow would look like their vermilion: violet stands for it) and lightened for dark; dashes tell them apart without. */
const LIGHT = ["#0b5c8f", "#b84a00", "#007a5a", "#a8447f", "#24292e", "#8424d8"];
const DARK = ["#6cb8ec", "#ff9d5c", "#3ecfa3", "#f0a3cd", "#e6e9ec", "#f2cf5b"];
const DASHES: number[][] = [[], [8, 4], [3, 3], [9, 3, 2, 3], [2, 2], [12, 4, 2, 4, 2, 4]];

export interface Stroke {
  color: string;
  dash: number[];
}

/** Each colour comes with another dash in every round, so that 36 curves differ. */
export function stroke(index: number, dark: boolean): Stroke {
  const colors = dark ? DARK : LIGHT;
  return { color: colors[index % colors.length]!, dash: DASHES[(index + Math.floor(index / colors.length)) % DASHES.length]! };
}
