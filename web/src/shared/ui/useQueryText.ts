import { useCallback, useLayoutEffect, useMemo, useRef } from "react";
import { useLocation, useNavigate, useNavigation, type Location, type NavigateOptions } from "react-router";

/** What a place is about to become: changes that meet before the page is drawn anew go on from one another. */
const ahead = new WeakMap<Location, URLSearchParams>();

const IN_PLACE: NavigateOptions = { replace: true, preventScrollReset: true };

export type ChangeQuery = (to: (before: URLSearchParams) => URLSearchParams, options?: NavigateOptions) => void;

/**
 * What the address says after its question mark, and how it is told something else, by default without a step in the history.
 * Each change begins with what all before it have left, whichever part of the page made them. (`setSearchParams` of the
 * router begins with what was drawn last: of two changes within one moment the first is lost.) A page that is being left changes
 * nothing any more: it would call back whoever waits for the next one.
 */
export function useQueryText(): [URLSearchParams, ChangeQuery] {
  const location = useLocation();
  const navigate = useNavigate();
  const next = useNavigation().location;
  const leaving = next !== undefined && next.pathname !== location.pathname;
  const query = useMemo(() => new URLSearchParams(location.search), [location.search]);
  const drawn = useRef({ location, leaving });
  useLayoutEffect(() => {
    drawn.current = { location, leaving };
  }, [location, leaving]);
  const change = useCallback<ChangeQuery>(
    (to, options = IN_PLACE) => {
      if (drawn.current.leaving) return;
      const here = drawn.current.location;
      const before = (ahead.get(here) ?? new URLSearchParams(here.search)).toString();
      const next = to(new URLSearchParams(before));
      if (next.toString() === before) return;
      ahead.set(here, next);
      void navigate({ search: next.toString() }, options);
    },
    [navigate],
  );
  return [query, change];
}
