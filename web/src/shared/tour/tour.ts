import { create } from "zustand";

/** Where a visitor is in the tour: the offer to open the study, its slider, its search; over for good once it is left. */
export type Stage = "study" | "panel" | "optimise" | "over";
export const STAGES = ["study", "panel", "optimise"] as const satisfies readonly Stage[];

interface Tour {
  stage: Stage;
  /** The system that the tour has made of the study. */
  system: string;
}

const KEY = "servotune-tour";

/** What a browser remembers of the tour; whatever else lies there counts as a first visit. */
export function readTour(text: string | null): Tour {
  try {
    const { stage, system } = JSON.parse(text ?? "") as Partial<Tour>;
    if (stage === "over") return { stage, system: "" };
    if ((stage === "panel" || stage === "optimise") && typeof system === "string" && system !== "") return { stage, system };
  } catch {
    // Nothing is remembered yet.
  }
  return { stage: "study", system: "" };
}

interface Guide extends Tour {
  go(stage: Stage, system?: string): void;
}

export const useTour = create<Guide>((set, get) => ({
  ...readTour(localStorage.getItem(KEY)),
  go(stage, system = get().system) {
    localStorage.setItem(KEY, JSON.stringify({ stage, system }));
    set({ stage, system });
  },
}));

/** The page on which a step takes place. */
export function placeOf({ stage, system }: Tour): string {
  return stage === "panel" || stage === "optimise" ? `/systems/${system}/${stage}` : "/systems";
}

/** Whether a step's task is done, as far as the address shows: a slider that was moved, a search that was started. */
export function isDone(stage: Stage, pathname: string, search: string): boolean {
  if (stage === "panel") return [...new URLSearchParams(search).keys()].some((key) => key.startsWith("p."));
  return stage === "optimise" && pathname.startsWith("/jobs/");
}
