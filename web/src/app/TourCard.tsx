import { Button, CloseButton, Group, Paper, Text, Title } from "@mantine/core";
import { useEffect, useRef } from "react";
import { useTranslation } from "react-i18next";
import { Link, useLocation, useNavigate } from "react-router";
import { isDone, placeOf, STAGES, useTour } from "@/shared/tour/tour";
import classes from "./TourCard.module.css";

/** The second and third step of the tour, in a corner of whatever page is open; the first is the offer among the systems. */
export function TourCard() {
  const { t } = useTranslation();
  const navigate = useNavigate();
  const { pathname, search } = useLocation();
  const { stage, system, go } = useTour();
  const title = useRef<HTMLHeadingElement>(null);
  const before = useRef(stage);
  useEffect(() => {
    document.documentElement.dataset.tour = stage;
    // Told when a step begins, not whenever a page is loaded.
    if (before.current !== stage) title.current?.focus();
    before.current = stage;
    return () => void delete document.documentElement.dataset.tour;
  }, [stage]);
  if (stage !== "panel" && stage !== "optimise") return null;
  const last = stage === "optimise";
  const here = pathname === placeOf({ stage, system });
  const done = isDone(stage, pathname, search);
  const to = (next: "panel" | "optimise") => {
    go(next);
    void navigate(placeOf({ stage: next, system }));
  };
  return (
    <Paper withBorder p="md" component="aside" className={classes.card} aria-labelledby="tour" data-testid="tour" onKeyDown={(event) => event.key === "Escape" && go("over")}>
      <Group justify="space-between" wrap="nowrap" align="flex-start">
        <Title order={2} id="tour" ref={title} tabIndex={-1}>
          {t("tour.step", { number: STAGES.indexOf(stage) + 1, count: STAGES.length, title: t(`tour.${stage}.title`) })}
        </Title>
        <CloseButton size="sm" aria-label={t("tour.close")} onClick={() => go("over")} />
      </Group>
      <Text fz="sm" my="xs">
        {t(`tour.${stage}.text`)}
      </Text>
      <Text fz="sm" fw={600} mb="xs" role="status">
        {done && `✓ ${t(`tour.${stage}.done`)}`}
      </Text>
      <Group gap="xs">
        {last && (
          <Button variant="default" onClick={() => to("panel")}>
            {t("tour.before")}
          </Button>
        )}
        {!here && !done && (
          <Button variant="default" component={Link} to={placeOf({ stage, system })}>
            {t("tour.return")}
          </Button>
        )}
        <Button variant={done ? "filled" : "default"} onClick={() => (last ? go("over") : to("optimise"))}>
          {t(last ? "tour.end" : "tour.next")}
        </Button>
      </Group>
    </Paper>
  );
}
