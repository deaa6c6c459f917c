import { Button, Group, Paper, Text, Title } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { STAGES, useTour } from "@/shared/tour/tour";
import type { Template } from "./templates";

/** The study that the tour is about: the linear hydraulic motor. */
const STUDY = "hydraulic-velocity";

/** The first step of the tour, for whoever is here for the first time: it opens the study. */
export function TourOffer({ onOpen, busy }: { onOpen(template: Template): void; busy: boolean }) {
  const { t } = useTranslation();
  const { stage, go } = useTour();
  if (stage !== "study") return null;
  const begin = async () => {
    const { templates } = await import("./templates");
    onOpen(templates.find(({ id }) => id === STUDY)!);
  };
  return (
    <Paper withBorder p="md" component="section" aria-labelledby="tour-offer" data-testid="tour-offer">
      <Title order={2} id="tour-offer">
        {t("tour.step", { number: 1, count: STAGES.length, title: t("tour.study.title") })}
      </Title>
      <Text fz="sm" my="xs" maw={760}>
        {t("tour.study.text")}
      </Text>
      <Group gap="xs">
        <Button onClick={() => void begin()} loading={busy}>
          {t("tour.begin")}
        </Button>
        <Button variant="default" onClick={() => go("over")}>
          {t("tour.skip")}
        </Button>
      </Group>
    </Paper>
  );
}
