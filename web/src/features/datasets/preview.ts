/** The first lines of a text file, split as the import will split them. */

export interface Column {
  index: number;
  name: string;
  unit: string;
  scale: number;
  take: boolean;
}

export interface Layout {
  delimiter: string;
  decimal: "." | ",";
  header_lines: number;
}

const DELIMITERS = ["\t", ";", ",", " "];

function split(line: string, delimiter: string): string[] {
  return delimiter === " " ? line.trim().split(/\s+/) : line.split(delimiter).map((cell) => cell.trim());
}

function isNumber(cell: string, decimal: string): boolean {
  return cell !== "" && Number.isFinite(Number(decimal === "," ? cell.replace(",", ".") : cell));
}

/** Guesses delimiter, decimal sign and header: the split in which the most lines are numbers throughout. */
export function guessLayout(lines: string[]): Layout {
  let best: Layout = { delimiter: ",", decimal: ".", header_lines: 0 };
  let most = 0;
  for (const delimiter of DELIMITERS) {
    for (const decimal of [".", ","] as const) {
      if (delimiter === decimal) continue;
      const good = lines.map((line) => {
        const cells = split(line, delimiter).filter((cell, i, all) => cell !== "" || i < all.length - 1);
        return cells.length > 0 && cells.every((cell) => isNumber(cell, decimal)) ? cells.length : 0;
      });
      const header = good.findIndex((count) => count > 0);
      const score = good.reduce((sum, count) => sum + count, 0);
      if (header >= 0 && score > most) {
        most = score;
        best = { delimiter, decimal, header_lines: header };
      }
    }
  }
  return best;
}

/** Names from the last line of the header, with units that stand behind them: `position [mm]`, `force (N)`. */
export function columnsOf(lines: string[], layout: Layout): Column[] {
  const first = split(lines[layout.header_lines] ?? "", layout.delimiter);
  const header = layout.header_lines > 0 ? split(lines[layout.header_lines - 1]!, layout.delimiter) : [];
  const used = new Set<string>();
  return first.flatMap((cell, index) => {
    if (cell === "") return [];
    const found = /^(.*?)\s*[[(]([^\])]*)[\])]\s*$/.exec(header[index] ?? "");
    const plain = (found?.[1] ?? header[index] ?? "").toLowerCase().replace(/[^a-z0-9_]+/g, "_").replace(/^[^a-z]+|_+$/g, "");
    let name = plain || `channel_${index + 1}`;
    while (used.has(name)) name = `${name}_${index + 1}`;
    used.add(name);
    return [{ index, name, unit: found?.[2] ?? "1", scale: 1, take: true }];
  });
}

/** Samples per second by a column of time that rises evenly; null where there is none. */
export function rateOf(lines: string[], layout: Layout, index: number): number | null {
  const times = lines.slice(layout.header_lines).map((line) => Number((split(line, layout.delimiter)[index] ?? "").replace(layout.decimal, ".")));
  const span = (times.at(-1) ?? NaN) - (times[0] ?? NaN);
  const step = span / (times.length - 1);
  if (!(step > 0) || times.some((time, i) => Math.abs(time - times[0]! - i * step) > 0.02 * step)) return null;
  return Number((1 / step).toPrecision(6));
}

export function cellsOf(lines: string[], layout: Layout, most: number): string[][] {
  return lines.slice(layout.header_lines, layout.header_lines + most).map((line) => split(line, layout.delimiter));
}
