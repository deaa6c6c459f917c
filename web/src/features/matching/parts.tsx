import { Alert, Button, Group, NativeSelect, Text, type NativeSelectProps } from "@mantine/core";
import { useTranslation } from "react-i18next";
import type { components } from "@/shared/api/schema";
import { formatNumber } from "@/shared/units/format";

/** Whether constants of the sensors are estimated, too. */
export function OffsetsSelect(props: NativeSelectProps) {
  const { t } = useTranslation();
  return <NativeSelect size="xs" w={190} label={t("matching.offsets")} description={t("matching.offsetsDoc")} {...props} data={[{ value: "none", label: t("matching.no") }, { value: "estimate", label: t("matching.estimate") }]} />;
}

/** Now, or again and again: every request of these pages can become a schedule. */
export function StartButtons({ go, busy, onAsk, asking = false, onSchedule }: { go: string; busy: boolean; onAsk?(): void; asking?: boolean; onSchedule?(): void }) {
  const { t } = useTranslation();
  return (
    <Group>
      <Button type="submit" loading={busy}>
        {go}
      </Button>
      {onAsk && (
        <Button variant="default" onClick={onAsk} loading={asking}>
          {t("matching.ask")}
        </Button>
      )}
      {onSchedule && (
        <Button variant="default" onClick={onSchedule}>
          {t("schedules.new")}
        </Button>
      )}
    </Group>
  );
}

/** What a search would take, and what it would warn of. */
export function ExpectedCost({ expected, warnings }: components["schemas"]["ExpectedReply"]) {
  const { t } = useTranslation();
  if (!expected) return null;
  return (
    <Alert color={warnings.length > 0 ? "orange" : "blue"} variant="outline" role="status" data-testid="expected">
      <Text fz="sm">{t("matching.expected", { count: expected.evaluations, seconds: formatNumber(expected.seconds, 2), megabytes: formatNumber(expected.bytes / 1e6, 2) })}</Text>
      {warnings.map(({ detail }) => (
        <Text key={detail} fz="sm">
          {detail}
        </Text>
      ))}
    </Alert>
  );
}
