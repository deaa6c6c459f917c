import { Badge } from "@mantine/core";
import { useTranslation } from "react-i18next";

const COLORS: Record<string, string> = { succeeded: "green", ready: "green", running: "blue", parsing: "blue", failed: "red", cancelled: "gray", queued: "gray", open: "gray" };
const SIGNS: Record<string, string> = { succeeded: "✓", ready: "✓", failed: "✗", running: "▸", parsing: "▸", cancelled: "–" };

export function StatusBadge({ status }: { status: string }) {
  const { t } = useTranslation();
  return (
    <Badge variant="outline" color={COLORS[status] ?? "gray"} tt="none" c="var(--ink)" leftSection={SIGNS[status]}>
      {t(`status.${status}`, status)}
    </Badge>
  );
}
