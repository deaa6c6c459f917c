import { useTranslation } from "react-i18next";
import type { components } from "@/shared/api/schema";
import { DataTable, NameLink } from "@/shared/ui/DataTable";
import { StatusBadge } from "@/shared/ui/StatusBadge";
import { When } from "@/shared/ui/When";

/** Measurements, each with the way to its page. */
export function AcquisitionTable({ rows }: { rows: components["schemas"]["AcquisitionHead"][] }) {
  const { t } = useTranslation();
  return (
    <DataTable
      testId="measurements"
      highlight
      rows={rows}
      keyOf={(row) => row.id}
      columns={[
        { title: t("systems.name"), cell: (row) => <NameLink to={`/acquisitions/${row.id}`}>{row.name}</NameLink> },
        { title: t("rigs.rig"), cell: (row) => row.rig },
        { title: t("jobs.status"), cell: (row) => <StatusBadge status={row.status} /> },
        { title: t("jobs.begun"), cell: (row) => <When at={row.created_at} /> },
      ]}
    />
  );
}
