import { Table } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { formatNumber, words } from "@/shared/units/format";
import type { FitRow } from "./results";

const MEASURES = ["fit_percent", "relative_error_percent", "vaf_percent", "nrmse_percent"] as const;

/** Measures of agreement by their own names, and beside them those of models that know nothing. */
export function FitTable({ rows }: { rows: FitRow[] }) {
  const { t } = useTranslation();
  return (
    <Table.ScrollContainer minWidth={620}>
      <Table maw={860} data-testid="fits">
        <Table.Thead>
          <Table.Tr>
            <Table.Th>{t("panel.output")}</Table.Th>
            <Table.Th>{t("found.judged")}</Table.Th>
            {MEASURES.map((measure) => (
              <Table.Th key={measure} ta="right">
                {t(`found.measures.${measure}`)}
              </Table.Th>
            ))}
          </Table.Tr>
        </Table.Thead>
        <Table.Tbody>
          {rows.map(({ part, output, numbers, trivial }) => (
            <Table.Tr key={`${part}.${output}`} c={trivial ? "dimmed" : undefined}>
              <Table.Td>{words(output)}</Table.Td>
              <Table.Td>{t(`found.parts.${part}`, words(part))}</Table.Td>
              {MEASURES.map((measure) => (
                <Table.Td key={measure} ta="right" className="numbers" fw={!trivial && measure === "fit_percent" ? 600 : undefined}>
                  {numbers[measure] == null ? "–" : `${formatNumber(numbers[measure], 4)} %`}
                </Table.Td>
              ))}
            </Table.Tr>
          ))}
        </Table.Tbody>
      </Table>
    </Table.ScrollContainer>
  );
}
