import { Table, Text } from "@mantine/core";
import type { ReactNode } from "react";
import { useTranslation } from "react-i18next";
import { Link } from "react-router";

export interface Column<Row> {
  title: ReactNode;
  cell(row: Row, index: number): ReactNode;
  /** Numbers stand right, in digits of one width. */
  numeric?: boolean;
  strong?: boolean;
  width?: number;
}

interface Props<Row> {
  columns: Column<Row>[];
  rows: readonly Row[];
  keyOf(row: Row, index: number): string;
  /** Below this width the table scrolls in itself. */
  minWidth?: number;
  maxWidth?: number;
  testId?: string;
  label?: string;
  highlight?: boolean;
  /** Rows that are told apart from the rest, as less important. */
  dimmed?(row: Row): boolean;
}

/** Rows of one kind, one column for each thing that is said of them; a column without a title holds what can be done. */
export function DataTable<Row>({ columns, rows, keyOf, minWidth = 560, maxWidth, testId, label, highlight = false, dimmed }: Props<Row>) {
  const { t } = useTranslation();
  const align = (column: Column<Row>) => (column.numeric ? { ta: "right" as const } : {});
  return (
    <Table.ScrollContainer minWidth={minWidth}>
      <Table highlightOnHover={highlight} data-testid={testId} aria-label={label} {...(maxWidth ? { maw: maxWidth } : {})}>
        <Table.Thead>
          <Table.Tr>
            {columns.map((column, i) => (
              <Table.Th key={i} {...align(column)} w={column.width} aria-label={column.title === "" ? t("systems.actions") : undefined}>
                {column.title}
              </Table.Th>
            ))}
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {rows.map((row, k) => (
            <Table.Tr key={keyOf(row, k)} c={dimmed?.(row) ? "dimmed" : undefined}>
              {columns.map((column, i) => (
                <Table.Td key={i} {...align(column)} className={column.numeric ? "numbers" : undefined} fw={column.strong ? 600 : undefined}>
                  {column.cell(row, k)}
                </Table.Td>
              ))}
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </Table.ScrollContainer>
  );
}

/** The name of a thing, which leads to its page. */
export function NameLink({ to, children }: { to: string; children: ReactNode }) {
  return (
    <Text component={Link} to={to} c="var(--mantine-color-anchor)" fz="sm" fw={500}>
      {children}
    </Text>
  );
}
