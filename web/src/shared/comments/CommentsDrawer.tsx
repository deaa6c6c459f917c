import { Drawer } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { Comments } from "./Comments";

/** Comments beside the page that they are about, which stays in sight and does not move. */
export function CommentsDrawer({ about, onClose }: { about: string; onClose(): void }) {
  const { t } = useTranslation();
  return (
    <Drawer opened onClose={onClose} title={t("comments.title")} position="right" size="md" overlayProps={{ backgroundOpacity: 0.2 }} closeButtonProps={{ "aria-label": t("datasets.close") }}>
      <Comments about={about} />
    </Drawer>
  );
}
