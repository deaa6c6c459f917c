/** One thing that can be opened. */
export interface Entry {
  kind: Kind;
  title: string;
  /** What stands small beside it: of which system, in which state, which chapter. */
  about: string;
  /** Further words under which it is found, never shown: its id, a chapter's text. */
  words?: string;
  to: string;
  /** Outside of the pages of the client: the documentation. */
  outside?: boolean;
}

export const KINDS = ["pages", "systems", "optima", "jobs", "datasets", "results", "schedules", "rigs", "acquisitions", "comments", "documentation"] as const;
export type Kind = (typeof KINDS)[number];

export interface Found {
  kind: Kind;
  entries: Entry[];
  /** How many more there are of this kind. */
  more: number;
}

/** Of each kind; whoever looks for another one types another word. */
const MOST = 6;

/** Small letters without accents: `Programări` is found by `programari`. */
export function plain(text: string): string {
  return text.normalize("NFD").replace(/\p{M}/gu, "").toLowerCase();
}

/**
 * How well an entry answers words, all of which it must hold: 3 where the title begins with the first of them, 2 where a word of
 * the title begins with each, 1 where the title and what stands beside it hold them, 0.5 where only the rest does; 0 not at all.
 */
function fitOf(title: string, about: string, rest: string, asked: readonly string[]): number {
  const beside = `${title} ${about}`;
  if (!asked.every((word) => beside.includes(word) || rest.includes(word))) return 0;
  const begins = (word: string) => title.split(/[^\p{L}\p{N}]+/u).some((part) => part.startsWith(word)) || title.startsWith(word);
  if (asked.every(begins)) return title.startsWith(asked[0] ?? "") ? 3 : 2;
  return asked.every((word) => beside.includes(word)) ? 1 : 0.5;
}

/** Entries made ready to be looked through: with ten thousand of them that is not done for each letter. */
export type Index = { entry: Entry; title: string; about: string; rest: string }[];

export function indexOf(entries: readonly Entry[]): Index {
  return entries.map((entry) => ({ entry, title: plain(entry.title), about: plain(entry.about), rest: plain(entry.words ?? "") }));
}

/** Kinds of which nothing is offered before anything is asked: they are long texts, found by what is in them. */
const ASKED_FOR = new Set<Kind>(["comments", "documentation"]);

/** What holds all words of a text, the best of each kind first; of nothing, the first of each kind but those of long texts. */
export function found(index: Index, text: string): Found[] {
  const asked = plain(text).split(/\s+/).filter(Boolean);
  return KINDS.flatMap((kind) => {
    if (asked.length === 0 && ASKED_FOR.has(kind)) return [];
    const fitting = index.flatMap((one) => {
      const fit = one.entry.kind === kind ? fitOf(one.title, one.about, one.rest, asked) : 0;
      return fit > 0 ? [{ fit, entry: one.entry }] : [];
    });
    // Those that fit equally well stay in their order, the newest first.
    fitting.sort((a, b) => b.fit - a.fit);
    return fitting.length === 0 ? [] : [{ kind, entries: fitting.slice(0, MOST).map(({ entry }) => entry), more: Math.max(0, fitting.length - MOST) }];
  });
}
