import { ActionIcon, Text } from "@mantine/core";

/** The sentences that belong to one row, said beneath it; what an open field says itself is not repeated. */
export function RowFaults({ row, fields, faultAt }: { row: string; fields: readonly string[]; faultAt(field: string): string | undefined }) {
  const said = [...new Set(fields.flatMap((field) => faultAt(`${row}.${field}`) ?? []))];
  return said.length === 0 ? null : (
    <Text fz="xs" c="var(--mantine-color-error)" role="alert">
      {said.join("; ")}
    </Text>
  );
}

export function Drop({ label, onClick }: { label: string; onClick(): void }) {
  return (
    <ActionIcon variant="subtle" color="gray" aria-label={label} title={label} onClick={onClick}>
      ×
    </ActionIcon>
  );
}

/** Opens what a row has besides. */
export function More({ label, open, onClick }: { label: string; open: boolean; onClick(): void }) {
  return (
    <ActionIcon variant="subtle" color="gray" aria-label={label} title={label} aria-expanded={open} onClick={onClick}>
      {open ? "▴" : "▾"}
    </ActionIcon>
  );
}
