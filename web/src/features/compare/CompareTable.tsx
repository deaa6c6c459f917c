import { Button, CloseButton, Group, Table, Text, Title } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { Link } from "react-router";
import { download, fileName } from "@/shared/plots/export";
import { MetricValue } from "@/shared/ui/MetricValue";
import { withUnit, words } from "@/shared/units/format";
import { tableCsv, type Row } from "./overlaid";

/** What stands on top of a column, and how it is taken out: a design, or a recording. */
export interface Head {
  id: string;
  label: string;
  to: string;
  doc?: string;
  onDrop(): void;
}

interface Props {
  heads: readonly Head[];
  rows: readonly Row[];
  pending: boolean;
}

/** One column for each design and each recording, one line for each metric and each parameter that differs. */
export function CompareTable({ heads, rows, pending }: Props) {
  const { t } = useTranslation();
  const nameOf = (row: Row) => (row.kind === "metric" ? t(`metrics.${row.name}`, words(row.name)) : row.name);
  const save = () => download(fileName(t("compare.title"), "csv"), new Blob([tableCsv(heads.map(({ label }) => label), rows, { property: t("panel.property"), unit: t("compare.unit") })], { type: "text/csv" }));
  const parts = [
    { kind: "metric", title: t("panel.metrics") },
    { kind: "parameter", title: t("compare.parameters") },
  ] as const;
  return (
    <section>
      <Group justify="space-between" mb="xs">
        <Title order={2}>{t("compare.table")}</Title>
        <Button variant="default" onClick={save} disabled={pending}>
          {t("plot.csv")}
        </Button>
      </Group>
      <Table.ScrollContainer minWidth={220 + 150 * heads.length}>
        <Table withColumnBorders highlightOnHover w="auto" data-testid="comparison" aria-busy={pending}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th aria-label={t("panel.property")} />
              {heads.map((head) => (
                <Table.Th key={head.id} ta="right" miw={130} maw={240} title={head.doc}>
                  <Group gap={4} justify="flex-end" wrap="nowrap" align="flex-start">
                    <Text component={Link} to={head.to} c="var(--mantine-color-anchor)" fz="sm" fw={600}>
                      {head.label}
                    </Text>
                    <CloseButton size="sm" aria-label={t("compare.drop", { name: head.label })} onClick={head.onDrop} />
                  </Group>
                </Table.Th>
              ))}
            </Table.Tr>
          </Table.Thead>
          {parts.filter(({ kind }) => kind === "parameter" || rows.some((row) => row.kind === kind)).map(({ kind, title }) => (
            <Table.Tbody key={kind}>
              <Table.Tr>
                <Table.Th scope="rowgroup" colSpan={heads.length + 1} c="dimmed" fz="xs">
                  {title}
                </Table.Th>
              </Table.Tr>
              {rows
                .filter((row) => row.kind === kind)
                .map((row) => (
                  <Table.Tr key={row.name}>
                    <Table.Th scope="row" fw={400}>
                      {nameOf(row)}
                    </Table.Th>
                    {row.cells.map((cell, i) => (
                      <Table.Td key={heads[i]!.id} ta="right" className="numbers" title={cell?.advice ?? undefined}>
                        {cell === null ? "–" : kind === "metric" ? <MetricValue kind={row.name} metric={cell} /> : withUnit(cell.value!, cell.unit)}
                      </Table.Td>
                    ))}
                  </Table.Tr>
                ))}
              {kind === "parameter" && !rows.some((row) => row.kind === kind) && (
                <Table.Tr>
                  <Table.Td colSpan={heads.length + 1}>{t("compare.sameParameters")}</Table.Td>
                </Table.Tr>
              )}
            </Table.Tbody>
          ))}
        </Table>
      </Table.ScrollContainer>
    </section>
  );
}
