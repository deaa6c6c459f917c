import { Button, type ButtonProps } from "@mantine/core";
import { useInfiniteQuery } from "@tanstack/react-query";
import { lazy, Suspense, useState } from "react";
import { useTranslation } from "react-i18next";
import { commentsQuery } from "@/shared/api/comments";

const CommentsDrawer = lazy(async () => ({ default: (await import("./CommentsDrawer")).CommentsDrawer }));

/** How many comments there are on what a page shows as a whole, and the way to them beside it. */
export function CommentsButton({ about, variant = "default", ...look }: { about: string } & Pick<ButtonProps, "size" | "variant">) {
  const { t } = useTranslation();
  const [open, setOpen] = useState(false);
  const comments = useInfiniteQuery(commentsQuery(about));
  const count = comments.data?.pages.reduce((sum, page) => sum + page.items.length, 0) ?? 0;
  return (
    <>
      <Button variant={variant} {...look} onClick={() => setOpen(true)} aria-haspopup="dialog">
        {count === 0 ? t("comments.title") : `${t("comments.title")} (${count}${comments.hasNextPage ? "+" : ""})`}
      </Button>
      {open && (
        <Suspense fallback={null}>
          <CommentsDrawer about={about} onClose={() => setOpen(false)} />
        </Suspense>
      )}
    </>
  );
}
