import { Box, Group, Stack, Text, Title } from "@mantine/core";
import { useTranslation } from "react-i18next";
import type { RigDocument } from "./api";
import { firstDay } from "./firstDay";
import { Mark } from "./Mark";

/** What a lab goes through on its first day with a rig, each line with how it stands and what to do. */
export function FirstDay({ document, present, recorded }: { document: RigDocument; present: boolean; recorded: boolean }) {
  const { t } = useTranslation();
  const steps = firstDay(document, { present, recorded, today: new Date().toISOString().slice(0, 10) });
  const done = steps.filter((step) => step.result === "ok").length;
  return (
    <section>
      <Group justify="space-between" mb="xs">
        <Title order={2}>{t("rigs.firstDay.title")}</Title>
        <Text fz="xs" c="dimmed">
          {t("rigs.firstDay.done", { done, count: steps.length })}
        </Text>
      </Group>
      <Box component="ol" m={0} p={0} style={{ listStyle: "none" }} data-testid="first-day">
        {steps.map(({ what, result, names }) => (
          <Box component="li" key={what} py={4}>
            <Group gap="sm" align="flex-start" wrap="nowrap">
              <Mark result={result} label={t(`rigs.firstDay.found.${result ?? "open"}`)} />
              <Stack gap={0} miw={0}>
                <Text fz="sm" fw={500}>
                  {t(`rigs.firstDay.${what}`)}
                </Text>
                {result !== "ok" && (
                  <Text fz="xs" style={{ overflowWrap: "anywhere" }}>
                    {names.length > 0 && `${names.join(", ")}: `}
                    {t(`rigs.firstDay.todo.${what}`)}
                  </Text>
                )}
              </Stack>
            </Group>
          </Box>
        ))}
      </Box>
    </section>
  );
}
