import { useTranslation } from "react-i18next";
import { DataTable } from "@/shared/ui/DataTable";
import { formatNumber, words } from "@/shared/units/format";
import type { FitRow } from "./results";

const MEASURES = ["fit_percent", "relative_error_percent", "vaf_percent", "nrmse_percent"] as const;

/** Measures of agreement by their own names, and beside them those of models that know nothing. */
export function FitTable({ rows }: { rows: FitRow[] }) {
  const { t } = useTranslation();
  return (
    <DataTable
      testId="fits"
      minWidth={620}
      maxWidth={860}
      rows={rows}
      keyOf={({ part, output }) => `${part}.${output}`}
      dimmed={({ trivial }) => trivial}
      columns={[
        { title: t("found.output"), cell: ({ output }) => words(output) },
        { title: t("found.judged"), cell: ({ part }) => t(`found.parts.${part}`, words(part)) },
        ...MEASURES.map((measure) => ({ title: t(`found.measures.${measure}`), numeric: true, strong: measure === "fit_percent", cell: ({ numbers }: FitRow) => (numbers[measure] == null ? "–" : `${formatNumber(numbers[measure], 4)} %`) })),
      ]}
    />
  );
}
