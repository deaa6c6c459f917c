import { Alert, Stack, Table, Title } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { formatNumber, prettyUnit } from "@/shared/units/format";
import type { IdentificationResult } from "./results";

/** Identified values with their confidence, and how well the model then follows the recording. */
export function IdentificationView({ result }: { result: IdentificationResult }) {
  const { t } = useTranslation();
  const fits = Object.entries(result.fit ?? {}).flatMap(([part, outputs]) => (typeof outputs === "object" && outputs !== null && part !== "baselines" ? Object.entries(outputs).map(([output, numbers]) => ({ part, output, numbers })) : []));
  return (
    <Stack gap="lg">
      <Alert color={result.status === "converged" ? "green" : "orange"} variant="outline" title={t(`jobs.outcome.${result.status}`, result.status)}>
        {result.advice} {result.indistinguishable?.join(" ")}
      </Alert>
      <section>
        <Title order={2} mb="xs">
          {t("jobs.values")}
        </Title>
        <Table maw={760}>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>{t("panel.parameters")}</Table.Th>
              <Table.Th ta="right">{t("jobs.value")}</Table.Th>
              <Table.Th ta="right">95 %</Table.Th>
              <Table.Th ta="right">{t("jobs.start")}</Table.Th>
              <Table.Th>{t("jobs.unit")}</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {Object.entries(result.parameters).map(([name, found]) => (
              <Table.Tr key={name}>
                <Table.Td>{name}</Table.Td>
                <Table.Td ta="right" className="numbers" fw={600}>
                  {formatNumber(found.value, 5)}
                </Table.Td>
                <Table.Td ta="right" className="numbers">
                  {found.lower95 === null || found.upper95 === null ? "–" : `${formatNumber(found.lower95)} … ${formatNumber(found.upper95)}`}
                </Table.Td>
                <Table.Td ta="right" className="numbers">
                  {formatNumber(found.start)}
                </Table.Td>
                <Table.Td>{prettyUnit(found.unit)}</Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </section>
      <section>
        <Title order={2} mb="xs">
          {t("jobs.fit")}
        </Title>
        <Table maw={760}>
          <Table.Tbody>
            {fits.map(({ part, output, numbers }) => (
              <Table.Tr key={`${part}.${output}`}>
                <Table.Td>{t(`jobs.parts.${part}`, part)}</Table.Td>
                <Table.Td>{output}</Table.Td>
                <Table.Td ta="right" className="numbers">
                  {numbers.fit_percent == null ? "–" : `${formatNumber(numbers.fit_percent, 4)} %`}
                </Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </section>
    </Stack>
  );
}
