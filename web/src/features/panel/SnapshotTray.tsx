import { Button, Checkbox, CloseButton, Group, Modal, Table, Text } from "@mantine/core";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import type { LiveParameter } from "@/shared/live/protocol";
import type { Metric } from "@/shared/api/types";
import { MetricValue } from "@/shared/ui/MetricValue";
import { withUnit, words } from "@/shared/units/format";
import type { Snapshot } from "./state";
import classes from "@/shared/ui/Chip.module.css";

interface Props {
  snapshots: Snapshot[];
  parameters: Map<string, LiveParameter>;
  /** The moving values, those that differ from the document's. */
  values: Record<string, number>;
  metrics: string[];
  /** What was measured: of the moving curve, and of each snapshot that is shown. */
  measured: { label: string; metrics: Record<string, Metric> | undefined }[];
  onChange(snapshots: Snapshot[]): void;
  onApply(values: Record<string, number>): void;
}

const MOST = 8;

/** Settings that were kept: each shown as a curve, taken back, or compared with the others in a table. */
export function SnapshotTray({ snapshots, parameters, values, metrics, measured, onChange, onApply }: Props) {
  const { t } = useTranslation();
  const [comparing, setComparing] = useState(false);
  const keep = () => {
    let number = snapshots.length + 1;
    while (snapshots.some((one) => one.name === t("panel.snapshotName", { number }))) number++;
    onChange([...snapshots, { name: t("panel.snapshotName", { number }), shown: true, values: { ...values } }].slice(-MOST));
  };
  const shown = snapshots.filter((one) => one.shown);
  const columns = [{ label: t("panel.current"), values }, ...shown.map(({ name, values: own }) => ({ label: name, values: own }))];
  const paths = [...new Set(columns.flatMap((column) => Object.keys(column.values)))].filter((path) => parameters.has(path));
  return (
    <Group gap="xs" align="center" role="group" aria-label={t("panel.snapshots")} data-testid="snapshots">
      <Button variant="default" onClick={keep} disabled={snapshots.length >= MOST}>
        {t("panel.keep")}
      </Button>
      {snapshots.map((one) => (
        <span key={one.name} className={classes.chip} data-testid="snapshot">
          <Checkbox size="xs" checked={one.shown} label={one.name} onChange={(event) => onChange(snapshots.map((other) => (other === one ? { ...one, shown: event.currentTarget.checked } : other)))} />
          <Button size="compact-xs" variant="subtle" aria-label={t("panel.takeBackOf", { name: one.name })} onClick={() => onApply(one.values)}>
            {t("panel.takeBack")}
          </Button>
          <CloseButton size="xs" aria-label={t("panel.dropSnapshot", { name: one.name })} onClick={() => onChange(snapshots.filter((other) => other !== one))} />
        </span>
      ))}
      {shown.length > 0 && (
        <Button variant="default" onClick={() => setComparing(true)}>
          {t("panel.compareTable")}
        </Button>
      )}
      <Modal opened={comparing} onClose={() => setComparing(false)} title={t("panel.compareTable")} size="auto" closeButtonProps={{ "aria-label": t("panel.close") }}>
        <Table.ScrollContainer minWidth={420}>
          <Table withColumnBorders data-testid="compared">
            <Table.Thead>
              <Table.Tr>
                <Table.Th aria-label={t("panel.property")} />
                {columns.map((column) => (
                  <Table.Th key={column.label} ta="right">
                    {column.label}
                  </Table.Th>
                ))}
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {paths.map((path) => (
                <Table.Tr key={path}>
                  <Table.Th scope="row">{path}</Table.Th>
                  {columns.map((column) => (
                    <Table.Td key={column.label} ta="right" className="numbers">
                      {withUnit(column.values[path] ?? parameters.get(path)!.value, parameters.get(path)!.unit)}
                    </Table.Td>
                  ))}
                </Table.Tr>
              ))}
              {metrics.map((metric) => (
                <Table.Tr key={metric}>
                  <Table.Th scope="row">{t(`metrics.${metric}`, words(metric))}</Table.Th>
                  {columns.map((column) => {
                    const found = measured.find((one) => one.label === column.label)?.metrics?.[metric];
                    return (
                      <Table.Td key={column.label} ta="right" className="numbers">
                        {found ? <MetricValue kind={metric} metric={found} /> : "…"}
                      </Table.Td>
                    );
                  })}
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        </Table.ScrollContainer>
        {paths.length === 0 && <Text fz="sm">{t("panel.sameValues")}</Text>}
      </Modal>
    </Group>
  );
}
