import { useEffect, useRef } from "react";

export interface Actions {
  save(): void;
  undo(): void;
  redo(): void;
  remove(): void;
  group(): void;
  ungroup(): void;
  arrange(): void;
  all(): void;
  add(): void;
  connect(): void;
  output(): void;
  find(): void;
  frames(): void;
  enter(): void;
  rename(): void;
  up(): void;
  clear(): void;
}

/** What keys do on the page; letters only where nothing is typed. */
export function useKeys(actions: Actions): void {
  const latest = useRef(actions);
  latest.current = actions;
  useEffect(() => {
    const listen = (event: KeyboardEvent) => {
      const target = event.target as HTMLElement;
      const own = latest.current;
      const command = event.ctrlKey || event.metaKey;
      const key = event.key.toLowerCase();
      const act = (action: (() => void) | undefined) => {
        if (!action) return;
        event.preventDefault();
        action();
      };
      if (command && key === "s") return act(own.save);
      if (target.closest("[role=dialog], [role=listbox], [role=menu], [role=alertdialog]")) return;
      if (target.closest("input, textarea, select")) {
        // Back to the picture; a number entry has taken its old text back by then.
        if (event.key === "Escape") target.blur();
        return;
      }
      if (command) {
        const commands: Record<string, () => void> = { z: event.shiftKey ? own.redo : own.undo, y: own.redo, a: own.all, g: event.shiftKey ? own.ungroup : own.group };
        return act(commands[key]);
      }
      if (event.altKey) return act(event.key === "ArrowUp" ? own.up : undefined);
      const onButton = target.closest("button, a") !== null;
      const keys: Record<string, (() => void) | undefined> = { delete: own.remove, backspace: own.remove, a: own.add, c: own.connect, o: own.output, l: own.arrange, f: own.frames, "/": own.find, f2: own.rename, escape: own.clear, enter: onButton ? undefined : own.enter };
      act(keys[key]);
    };
    window.addEventListener("keydown", listen);
    return () => window.removeEventListener("keydown", listen);
  }, []);
}
