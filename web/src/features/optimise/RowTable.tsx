import { Button, Group, Table, Text, Title } from "@mantine/core";
import { Fragment, useState, type ReactNode } from "react";
import { useTranslation } from "react-i18next";
import { Drop, More, RowFaults } from "./parts";

/** Of a field: what stands beside one stands at its height, also where the row grows by what is wrong. */
export const LINE = "30px";

interface Props<Row> {
  testId: string;
  title: string;
  doc: string;
  /** Where the rows stand in the form, and the fields of each of which something can be wrong. */
  field: string;
  fields: readonly string[];
  faultAt(field: string): string | undefined;
  heads: { title: string; numeric?: boolean; width?: number }[];
  rows: readonly Row[];
  /** What stands in a row, a cell for each head; what is wrong with the row is said in the first. */
  cells(row: Row, index: number): ReactNode[];
  /** What a row has besides, how the button that shows it is named, and whether it is shown in any case; null where it has nothing. */
  more(row: Row, index: number): { label: string; said: boolean; content: ReactNode } | null;
  dropLabel(row: Row): string;
  onDrop(index: number): void;
  add: { label: string; disabled?: boolean; onClick(): void };
  minWidth: number;
  maxWidth: number;
}

/** Rows that are added, filled in and taken away: the part that variables and goals have in common. */
export function RowTable<Row>({ testId, title, doc, field, fields, faultAt, heads, rows, cells, more, dropLabel, onDrop, add, minWidth, maxWidth }: Props<Row>) {
  const { t } = useTranslation();
  const [open, setOpen] = useState<ReadonlySet<number>>(new Set());
  const toggle = (i: number) => setOpen((before) => new Set(before.has(i) ? [...before].filter((k) => k !== i) : [...before, i]));
  const ofAll = faultAt(field);
  return (
    <section data-testid={testId}>
      <Title order={2}>{title}</Title>
      <Text fz="sm" c="dimmed" mb="xs">
        {doc}
      </Text>
      {rows.length > 0 && (
        <Table.ScrollContainer minWidth={minWidth}>
          <Table maw={maxWidth} verticalSpacing={4} horizontalSpacing={6}>
            <Table.Thead>
              <Table.Tr>
                {heads.map((head) => (
                  <Table.Th key={head.title} w={head.width} ta={head.numeric ? "right" : undefined}>
                    {head.title}
                  </Table.Th>
                ))}
                <Table.Th aria-label={t("systems.actions")} />
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {rows.map((row, i) => {
                const besides = more(row, i);
                const wide = besides !== null && (besides.said || open.has(i));
                return (
                  <Fragment key={i}>
                    <Table.Tr style={{ verticalAlign: "top" }}>
                      {cells(row, i).map((cell, k) => (
                        <Table.Td key={k} ta={heads[k]?.numeric ? "right" : undefined} lh={heads[k]?.numeric ? LINE : undefined} className={heads[k]?.numeric ? "numbers" : undefined}>
                          {cell}
                          {k === 0 && <RowFaults row={`${field}.${i}`} fields={fields} faultAt={faultAt} />}
                        </Table.Td>
                      ))}
                      <Table.Td w={76}>
                        <Group gap={0} wrap="nowrap" justify="flex-end">
                          {besides && <More label={besides.label} open={wide} onClick={() => toggle(i)} />}
                          <Drop label={dropLabel(row)} onClick={() => onDrop(i)} />
                        </Group>
                      </Table.Td>
                    </Table.Tr>
                    {wide && (
                      <Table.Tr>
                        <Table.Td colSpan={heads.length + 1} pt={0}>
                          {besides.content}
                        </Table.Td>
                      </Table.Tr>
                    )}
                  </Fragment>
                );
              })}
            </Table.Tbody>
          </Table>
        </Table.ScrollContainer>
      )}
      {ofAll && (
        <Text fz="xs" c="var(--mantine-color-error)" role="alert">
          {ofAll}
        </Text>
      )}
      <Button variant="default" mt="xs" disabled={add.disabled ?? false} onClick={add.onClick}>
        {add.label}
      </Button>
    </section>
  );
}
