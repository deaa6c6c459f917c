import { Button, Kbd } from "@mantine/core";
import { lazy, Suspense, useEffect, useRef, useState } from "react";
import { useTranslation } from "react-i18next";

const Finder = lazy(async () => ({ default: (await import("./Finder")).Finder }));

/** The door to everything: a button, and Ctrl K on every page. */
export function FinderButton() {
  const { t } = useTranslation();
  const [opened, setOpened] = useState(false);
  const [text, setText] = useState("");
  const waiting = useRef(false);
  const open = () => {
    waiting.current = true;
    setText("");
    setOpened(true);
  };
  const close = () => {
    waiting.current = false;
    setOpened(false);
  };
  useEffect(() => {
    /** What is typed before the field is there, or has the focus, is written into it. */
    const early = (event: KeyboardEvent) => {
      if (!waiting.current || event.ctrlKey || event.metaKey || event.altKey || event.isComposing) return;
      if (event.target instanceof Element && event.target.closest("[role=dialog]")) return;
      if (event.key === "Escape") close();
      else if (event.key === "Backspace") setText((before) => before.slice(0, -1));
      else if ([...event.key].length === 1) setText((before) => before + event.key);
      else return;
      event.preventDefault();
    };
    const listen = (event: KeyboardEvent) => {
      early(event);
      if (event.key.toLowerCase() !== "k" || !(event.ctrlKey || event.metaKey) || event.shiftKey || event.altKey) return;
      // A browser's own search field would come instead, over a dialog too.
      event.preventDefault();
      if (!waiting.current && !document.querySelector("[role=dialog], [role=alertdialog]")) open();
    };
    window.addEventListener("keydown", listen);
    return () => window.removeEventListener("keydown", listen);
  }, []);
  return (
    <>
      <Button variant="default" onClick={open} aria-haspopup="dialog" aria-keyshortcuts="Control+K Meta+K" rightSection={<Kbd size="xs" visibleFrom="lg" aria-hidden>Ctrl K</Kbd>}>
        {t("finder.open")}
      </Button>
      {opened && (
        <Suspense>
          <Finder text={text} onText={setText} onClose={close} />
        </Suspense>
      )}
    </>
  );
}
