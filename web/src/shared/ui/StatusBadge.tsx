import { Badge } from "@mantine/core";
import { useTranslation } from "react-i18next";

const COLORS: Record<string, string> = { succeeded: "green", ready: "green", running: "blue", parsing: "blue", failed: "red", cancelled: "gray", queued: "gray", open: "gray", done: "green", claimed: "blue", uploading: "blue", lost: "red" };
const SIGNS: Record<string, string> = { succeeded: "✓", ready: "✓", failed: "✗", running: "▸", parsing: "▸", cancelled: "–", done: "✓", lost: "✗", uploading: "▸", claimed: "▸" };

export function StatusBadge({ status }: { status: string }) {
  const { t } = useTranslation();
  return (
    <Badge variant="outline" color={COLORS[status] ?? "gray"} tt="none" c="var(--ink)" leftSection={SIGNS[status]}>
      {t(`status.${status}`, status)}
    </Badge>
  );
}
