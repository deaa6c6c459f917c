import { Table } from "@mantine/core";
import { useTranslation } from "react-i18next";
import type { Metric } from "@/shared/api/types";
import { MetricValue } from "@/shared/ui/MetricValue";
import { words } from "@/shared/units/format";
import type { GoalResult } from "../results";

interface Props {
  goals: GoalResult[];
  /** A step of the search or a point of the front, looked at between the two; its metrics come as they are computed. */
  between: { label: string; goals: (Metric | null)[]; stale: boolean } | null;
}

/** Every goal before and after, and at the step that is looked at. */
export function GoalTable({ goals, between }: Props) {
  const { t } = useTranslation();
  const shown = (metric: string, found: Metric | null | undefined) => (found ? <MetricValue kind={metric} metric={found} /> : "–");
  return (
    <Table.ScrollContainer minWidth={520}>
      <Table maw={960} data-testid="goals">
        <Table.Thead>
          <Table.Tr>
            <Table.Th>{t("influence.metric")}</Table.Th>
            <Table.Th>{t("optimise.of")}</Table.Th>
            <Table.Th ta="right">{t("revisions.before")}</Table.Th>
            {between && <Table.Th ta="right">{between.label}</Table.Th>}
            <Table.Th ta="right">{t("revisions.after")}</Table.Th>
            <Table.Th>{t("jobs.met")}</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {goals.map((goal, i) => (
            <Table.Tr key={i}>
              <Table.Td>{t(`metrics.${goal.metric}`, words(goal.metric))}</Table.Td>
              <Table.Td>{goal.output ?? ""}</Table.Td>
              <Table.Td ta="right" className="numbers">
                {shown(goal.metric, goal.before)}
              </Table.Td>
              {between && (
                <Table.Td ta="right" className="numbers" fw={600} aria-busy={between.stale} data-testid="between">
                  {between.stale ? "…" : shown(goal.metric, between.goals[i])}
                </Table.Td>
              )}
              <Table.Td ta="right" className="numbers" fw={600}>
                {shown(goal.metric, goal.after)}
              </Table.Td>
              <Table.Td>
                {goal.met ? "✓" : "✗"} {goal.active && t("jobs.active")}
              </Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </Table.ScrollContainer>
  );
}
