import { Button, Kbd } from "@mantine/core";
import { lazy, Suspense, useEffect, useState } from "react";
import { useTranslation } from "react-i18next";

const Finder = lazy(async () => ({ default: (await import("./Finder")).Finder }));

/** The door to everything: a button, and Ctrl K on every page. */
export function FinderButton() {
  const { t } = useTranslation();
  const [opened, setOpened] = useState(false);
  useEffect(() => {
    const listen = (event: KeyboardEvent) => {
      if (event.key.toLowerCase() !== "k" || !(event.ctrlKey || event.metaKey) || event.shiftKey || event.altKey) return;
      // A browser's own search field would come instead, over a dialog too.
      event.preventDefault();
      if (!document.querySelector("[role=dialog], [role=alertdialog]")) setOpened(true);
    };
    window.addEventListener("keydown", listen);
    return () => window.removeEventListener("keydown", listen);
  }, []);
  return (
    <>
      <Button variant="default" onClick={() => setOpened(true)} aria-haspopup="dialog" aria-keyshortcuts="Control+K Meta+K" rightSection={<Kbd size="xs" visibleFrom="lg" aria-hidden>Ctrl K</Kbd>}>
        {t("finder.open")}
      </Button>
      {opened && (
        <Suspense>
          <Finder onClose={() => setOpened(false)} />
        </Suspense>
      )}
    </>
  );
}
