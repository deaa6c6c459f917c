import { Table, Text } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { Link } from "react-router";
import type { components } from "@/shared/api/schema";
import { StatusBadge } from "@/shared/ui/StatusBadge";
import { When } from "@/shared/ui/When";

export function AcquisitionTable({ rows }: { rows: components["schemas"]["AcquisitionHead"][] }) {
  const { t } = useTranslation();
  return (
    <Table.ScrollContainer minWidth={560}>
      <Table highlightOnHover data-testid="measurements">
        <Table.Thead>
          <Table.Tr>
            <Table.Th>{t("systems.name")}</Table.Th>
            <Table.Th>{t("rigs.rig")}</Table.Th>
            <Table.Th>{t("jobs.status")}</Table.Th>
            <Table.Th>{t("jobs.begun")}</Table.Th>
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {rows.map((row) => (
            <Table.Tr key={row.id}>
              <Table.Td>
                <Text component={Link} to={`/acquisitions/${row.id}`} c="var(--mantine-color-anchor)" fz="sm" fw={500}>
                  {row.name}
                </Text>
              </Table.Td>
              <Table.Td>{row.rig}</Table.Td>
              <Table.Td>
                <StatusBadge status={row.status} />
              </Table.Td>
              <Table.Td>
                <When at={row.created_at} />
              </Table.Td>
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </Table.ScrollContainer>
  );
}
