import { Button, FileButton, Stack, Text, TextInput } from "@mantine/core";
import { useInfiniteQuery } from "@tanstack/react-query";
import { useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import { datasetsQuery } from "@/shared/api/datasets";
import { DataTable, NameLink } from "@/shared/ui/DataTable";
import { Empty } from "@/shared/ui/Empty";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { StatusBadge } from "@/shared/ui/StatusBadge";
import { useAsked } from "@/shared/ui/useAsked";
import { useQueryText } from "@/shared/ui/useQueryText";
import { When } from "@/shared/ui/When";
import { UploadPanel } from "./UploadPanel";

/** Recordings: what is there, and the way in for files of every format. */
export function DatasetsPage() {
  const { t } = useTranslation();
  const [query, setQuery] = useQueryText();
  const search = query.get("q") ?? "";
  const asked = useAsked(search);
  const datasets = useInfiniteQuery(datasetsQuery({ name: asked }));
  const [file, setFile] = useState<File | null>(null);
  const choose = useRef<HTMLButtonElement>(null);
  const rows = datasets.data?.pages.flatMap((page) => page.items) ?? [];
  const find = (text: string) => setQuery(() => new URLSearchParams(text ? { q: text } : {}));
  const none = datasets.isSuccess && !datasets.isPlaceholderData && rows.length === 0;
  const empty = none && asked === "";
  return (
    <div className="page">
      <PageHead title={t("nav.datasets")} doc={t("datasets.doc")}>
        <FileButton onChange={setFile}>
          {(props) => (
            <Button {...props} ref={choose}>
              {t("datasets.import")}
            </Button>
          )}
        </FileButton>
      </PageHead>
      <Stack gap="md">
        <ProblemAlert error={datasets.error} onRetry={() => void datasets.refetch()} />
        {file && <UploadPanel key={`${file.name}${file.lastModified}`} file={file} onClose={() => setFile(null)} />}
        {empty && !file && (
          <Empty title={t("datasets.none")} action={<Button onClick={() => choose.current?.click()}>{t("datasets.chooseFirst")}</Button>}>
            {t("datasets.noneDoc")}
          </Empty>
        )}
        {datasets.isSuccess && !empty && <TextInput label={t("systems.search")} value={search} onChange={(event) => find(event.currentTarget.value)} maw={320} type="search" />}
        {none && !empty && <Text fz="sm">{t("datasets.noMatch", { search: asked })}</Text>}
        {rows.length > 0 && (
          <DataTable
            testId="datasets"
            highlight
            rows={rows}
            keyOf={(row) => row.id}
            columns={[
              { title: t("systems.name"), cell: (row) => <NameLink to={`/datasets/${row.id}`}>{row.name}</NameLink> },
              { title: t("importing.format"), cell: (row) => t(`importing.formats.${row.format}`, row.format) },
              { title: t("jobs.status"), cell: (row) => <StatusBadge status={row.status} /> },
              { title: t("datasets.kept"), cell: (row) => <When at={row.created_at} /> },
            ]}
          />
        )}
        {datasets.hasNextPage && (
          <Button variant="default" onClick={() => void datasets.fetchNextPage()}>
            {t("systems.further")}
          </Button>
        )}
      </Stack>
    </div>
  );
}
