import { useEffect, useRef } from "react";
import type { FieldValues, UseFormReturn } from "react-hook-form";
import { useLocation, useNavigationType } from "react-router";
import { useQueryText } from "../ui/useQueryText";
import { withParameters, type Parameters } from "./address";

/** Milliseconds without another change after which the address follows: browsers refuse more than a few changes of it a second. */
const REST = 250;

interface Held<Fields> {
  read(query: URLSearchParams): Fields;
  write(fields: Fields): Parameters;
}

/** Keeps what is filled into a form in the address of its page: a link, a reload and the way back show it as it stood. */
export function useAddress<Fields extends FieldValues>(form: UseFormReturn<Fields>, held: Held<Fields>): void {
  const [query, setQuery] = useQueryText();
  const location = useLocation();
  const way = useNavigationType();
  const latest = useRef({ query, held });
  useEffect(() => {
    latest.current = { query, held };
  });
  const { subscribe, getValues, reset } = form;
  useEffect(() => {
    let timer: ReturnType<typeof setTimeout> | undefined;
    let last = "";
    const put = () => {
      clearTimeout(timer);
      timer = undefined;
      const parameters = latest.current.held.write(getValues());
      // A form tells more than changes, also that it was submitted: the page may be on its way to what was asked for, which must not be undone.
      const told = JSON.stringify(parameters);
      if (told === last) return;
      last = told;
      setQuery((before) => withParameters(before, parameters));
    };
    const stop = subscribe({
      formState: { values: true },
      callback: () => {
        clearTimeout(timer);
        timer = setTimeout(put, REST);
      },
    });
    // Whoever leaves a field may be about to leave the page: the way back leads to what was filled in.
    const leave = () => {
      if (timer !== undefined) put();
    };
    const leaving = ["focusout", "submit"];
    // Before the form's own answer: what a submission leads to must come after what was filled in.
    for (const kind of leaving) document.addEventListener(kind, leave, { capture: true });
    return () => {
      clearTimeout(timer);
      stop();
      for (const kind of leaving) document.removeEventListener(kind, leave, { capture: true });
    };
  }, [subscribe, getValues, setQuery]);
  const shown = useRef(location.key);
  useEffect(() => {
    if (shown.current === location.key) return;
    shown.current = location.key;
    if (way === "POP") reset(latest.current.held.read(latest.current.query));
  }, [location.key, way, reset]);
}
