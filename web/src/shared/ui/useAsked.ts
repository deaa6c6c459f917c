import { useDebouncedValue } from "@mantine/hooks";

/** Milliseconds without another letter after which the service is asked for what was typed. */
const REST = 200;
/** Letters of a name that the service takes. */
const LONGEST = 200;

/** What a list is asked for while somebody types what to search for. */
export function useAsked(search: string): string {
  const [rested] = useDebouncedValue(search.trim().slice(0, LONGEST), REST);
  return rested;
}
