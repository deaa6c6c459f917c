import { Button } from "@mantine/core";
import { useTranslation } from "react-i18next";

/** Kinds of jobs and of kept results of which the service writes a report. */
const REPORTED = new Set(["optimization", "identification", "validation", "influence", "simulation", "frequency_response", "spectrum", "frf"]);

/** A report as one file, of a job or of a kept result at this address of the service. */
export function ReportLinks({ of, kind }: { of: string; kind: string }) {
  const { t, i18n } = useTranslation();
  if (!REPORTED.has(kind)) return null;
  return (["html", "pdf"] as const).map((form) => (
    <Button key={form} variant="default" component="a" href={`${of}/report?format=${form}&language=${i18n.language}`} download>
      {t(`jobs.report.${form}`)}
    </Button>
  ));
}
