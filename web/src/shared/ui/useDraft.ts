import { useEffect, useRef, useState } from "react";

export interface Draft {
  text: string;
  type(text: string): void;
  /** Whether anything was typed since it was last taken over or given up; from now on it was not. */
  take(): boolean;
  /** Back to what is given. */
  giveUp(): void;
}

/**
 * The text of an entry. What is being typed stands until it is taken over or given up: what is given meanwhile, by an answer of
 * the service or by another part of the page, is not written over it.
 */
export function useDraft(given: string): Draft {
  const [text, setText] = useState(given);
  const typing = useRef(false);
  useEffect(() => {
    if (!typing.current) setText(given);
  }, [given]);
  return {
    text,
    type(next) {
      typing.current = true;
      setText(next);
    },
    take() {
      const typed = typing.current;
      typing.current = false;
      return typed;
    },
    giveUp() {
      typing.current = false;
      setText(given);
    },
  };
}
