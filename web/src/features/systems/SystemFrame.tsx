import { Group, Text, Title } from "@mantine/core";
import { useDocumentTitle } from "@mantine/hooks";
import { useQuery } from "@tanstack/react-query";
import { useTranslation } from "react-i18next";
import { NavLink, Outlet, useParams } from "react-router";
import { CommentsButton } from "@/shared/comments/CommentsButton";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { systemQuery } from "@/shared/api/systems";
import classes from "./SystemFrame.module.css";

const VIEWS = ["panel", "diagram", "influence", "optimise", "revisions"] as const;

/** A system's name and its views; each view has its own address. */
export function SystemFrame() {
  const { t } = useTranslation();
  const { id = "" } = useParams();
  const system = useQuery(systemQuery(id));
  const name = system.data?.document.name || id;
  useDocumentTitle(`${name} · Servotune`);
  return (
    <div>
      <div className={classes.head}>
        <Group gap="sm" wrap="nowrap" miw={0}>
          <Title order={1} fz="md" className={classes.name}>
            {name}
          </Title>
          {system.data && (
            <Text span fz="xs" c="dimmed" style={{ whiteSpace: "nowrap" }}>
              {t("system.revision", { number: system.data.revision })}
            </Text>
          )}
          {system.data && <CommentsButton key={id} about={id} size="compact-xs" variant="subtle" />}
        </Group>
        <nav className={classes.views} aria-label={t("system.views")}>
          {VIEWS.map((view) => (
            <NavLink key={view} to={`/systems/${id}/${view}`}>
              {t(`system.${view}`)}
            </NavLink>
          ))}
        </nav>
      </div>
      {/* What is being worked on stays when the service is away for a while. */}
      {system.data ? <Outlet /> : system.isError && <ProblemAlert error={system.error} m="md" onRetry={() => void system.refetch()} />}
    </div>
  );
}
