import { Button, Group, NativeSelect, Text, Title } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useMemo } from "react";
import { useTranslation } from "react-i18next";
import { Link } from "react-router";
import { api, must } from "@/shared/api/client";
import type { components } from "@/shared/api/schema";
import { AnalysisChart } from "@/shared/charts/AnalysisChart";
import type { AnalysisSpec } from "@/shared/charts/analysis";
import { Pairs } from "@/shared/plots/Pairs";
import { DataTable } from "@/shared/ui/DataTable";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { useQueryText } from "@/shared/ui/useQueryText";
import { prettyUnit, words } from "@/shared/units/format";
import { measuredPoints } from "./frf";

export type FunctionHead = components["schemas"]["FunctionHead"];

/** The unit of a response over its reference, as the file has both. */
const unitOf = ({ response_unit, reference_unit }: FunctionHead) => [response_unit, reference_unit].map(prettyUnit).filter(Boolean).join(" / ");

/** What a file holds over frequency: every function of it, and one of them drawn. */
export function Functions({ id, functions }: { id: string; functions: FunctionHead[] }) {
  const { t } = useTranslation();
  const [query, setQuery] = useQueryText();
  const chosen = functions.find(({ name }) => name === query.get("function")) ?? functions[0]!;
  const found = useQuery({
    queryKey: ["function", id, chosen.name],
    staleTime: Infinity,
    queryFn: () => must(api.GET("/v1/datasets/{identifier}/functions/{name}", { params: { path: { identifier: id, name: chosen.name } } })),
  });
  const choose = (name: string) =>
    setQuery((next) => {
      next.set("function", name);
      return next;
    });
  return (
    <section data-testid="functions">
      <Group align="flex-end" mb="xs">
        <Title order={2}>{t("functions.title")}</Title>
        <NativeSelect size="xs" label={t("functions.drawn")} data={functions.map(({ name }) => ({ value: name, label: words(name) }))} value={chosen.name} onChange={(event) => choose(event.currentTarget.value)} />
        {measuredPoints(functions).inputs.length > 0 && (
          <Button component={Link} to={`/datasets/${id}/frf`} variant="default">
            {t("spectra.frf")}
          </Button>
        )}
      </Group>
      <ProblemAlert error={found.error} onRetry={() => void found.refetch()} />
      {found.data && <Drawn head={chosen} lines={found.data} />}
      <FunctionTable functions={functions} />
    </section>
  );
}

export function FunctionTable({ functions }: { functions: FunctionHead[] }) {
  const { t } = useTranslation();
  return (
    <DataTable
      testId="function-table"
      minWidth={560}
      maxWidth={960}
      rows={functions}
      keyOf={({ name }) => name}
      columns={[
        { title: t("functions.kind"), strong: true, cell: ({ kind }) => t(`functions.kinds.${kind}`, { defaultValue: kind }) },
        { title: t("functions.response"), cell: ({ response }) => words(response) },
        { title: t("functions.reference"), cell: ({ reference }) => words(reference) },
        { title: t("jobs.unit"), cell: unitOf },
        { title: t("functions.lines"), numeric: true, cell: ({ lines }) => lines },
      ]}
    />
  );
}

const plain = (values: (number | null)[] | null | undefined): Float64Array => Float64Array.from(values ?? [], (value) => value ?? NaN);

function Drawn({ head, lines }: { head: FunctionHead; lines: components["schemas"]["FunctionReply"] }) {
  const { t } = useTranslation();
  const [size, angle] = useMemo(() => {
    const [x, real, imag] = [plain(lines.frequency), plain(lines.real), plain(lines.imag)];
    const axis = { label: "ω", unit: "rad/s", log: true };
    const of = (y: Float64Array) => [{ label: words(head.name), x, y }];
    const share = head.kind === "coherence";
    const magnitude: AnalysisSpec = { title: share ? t("spectra.coherence") : t("spectra.magnitude"), x: axis, y: share ? { label: "γ²", unit: "", min: 0, max: 1 } : { label: "|G|", unit: unitOf(head), log: true }, lines: of(real.map((value, i) => (share ? value : Math.hypot(value, imag[i]!)))) };
    const phase: AnalysisSpec = { title: t("panel.phase"), x: axis, y: { label: t("panel.phaseShort"), unit: "°" }, lines: of(real.map((value, i) => (Math.atan2(imag[i]!, value) * 180) / Math.PI)) };
    return [magnitude, imag.some((value) => value !== 0) ? phase : null];
  }, [head, lines, t]);
  return (
    <>
      <Pairs mb="sm">
        <AnalysisChart spec={size!} height={280} summary={size!.title} />
        {angle && <AnalysisChart spec={angle} height={280} summary={angle.title} />}
      </Pairs>
      <Text fz="xs" c="dimmed" mb="sm">
        {t("functions.asInFile")}
      </Text>
    </>
  );
}
