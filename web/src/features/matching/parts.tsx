import { Button, Group, NativeSelect, type NativeSelectProps } from "@mantine/core";
import { useTranslation } from "react-i18next";

/** Whether constants of the sensors are estimated, too. */
export function OffsetsSelect(props: NativeSelectProps) {
  const { t } = useTranslation();
  return <NativeSelect size="xs" w={190} label={t("matching.offsets")} description={t("matching.offsetsDoc")} {...props} data={[{ value: "none", label: t("matching.no") }, { value: "estimate", label: t("matching.estimate") }]} />;
}

/** Now, or again and again: every request of these pages can become a schedule. */
export function StartButtons({ go, busy, onSchedule }: { go: string; busy: boolean; onSchedule?(): void }) {
  const { t } = useTranslation();
  return (
    <Group>
      <Button type="submit" loading={busy}>
        {go}
      </Button>
      {onSchedule && (
        <Button variant="default" onClick={onSchedule}>
          {t("schedules.new")}
        </Button>
      )}
    </Group>
  );
}
