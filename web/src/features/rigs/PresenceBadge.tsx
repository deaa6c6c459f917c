import { Badge } from "@mantine/core";
import { useTranslation } from "react-i18next";
import type { presence } from "./api";

const LOOK = { ready: ["green", "●"], waiting: ["blue", "…"], away: ["gray", "○"] } as const;

export function PresenceBadge({ state }: { state: ReturnType<typeof presence> }) {
  const { t } = useTranslation();
  return (
    <Badge variant="outline" color={LOOK[state][0]} tt="none" leftSection={LOOK[state][1]}>
      {t(`rigs.presence.${state}`)}
    </Badge>
  );
}
