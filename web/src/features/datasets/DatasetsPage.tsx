import { Button, FileButton, Stack, Text, TextInput } from "@mantine/core";
import { useInfiniteQuery } from "@tanstack/react-query";
import { useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import { api, must } from "@/shared/api/client";
import { DataTable, NameLink } from "@/shared/ui/DataTable";
import { Empty } from "@/shared/ui/Empty";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { StatusBadge } from "@/shared/ui/StatusBadge";
import { useQueryText } from "@/shared/ui/useQueryText";
import { When } from "@/shared/ui/When";
import { UploadPanel } from "./UploadPanel";

/** Recordings: what is there, and the way in for files of every format. */
export function DatasetsPage() {
  const { t } = useTranslation();
  const datasets = useInfiniteQuery({
    queryKey: ["datasets"],
    initialPageParam: undefined as string | undefined,
    queryFn: ({ pageParam }) => must(api.GET("/v1/datasets", { params: { query: { limit: 100, cursor: pageParam } } })),
    getNextPageParam: (page) => page.next_cursor ?? undefined,
  });
  const [file, setFile] = useState<File | null>(null);
  const choose = useRef<HTMLButtonElement>(null);
  const rows = datasets.data?.pages.flatMap((page) => page.items) ?? [];
  const [query, setQuery] = useQueryText();
  const search = query.get("q") ?? "";
  const find = (text: string) => setQuery(() => new URLSearchParams(text ? { q: text } : {}));
  const shown = rows.filter((row) => `${row.name} ${row.id}`.toLowerCase().includes(search.toLowerCase()));
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
        {datasets.isSuccess && rows.length === 0 && !file && (
          <Empty title={t("datasets.none")} action={<Button onClick={() => choose.current?.click()}>{t("datasets.chooseFirst")}</Button>}>
            {t("datasets.noneDoc")}
          </Empty>
        )}
        {rows.length > 0 && <TextInput label={t("systems.search")} value={search} onChange={(event) => find(event.currentTarget.value)} maw={320} type="search" />}
        {rows.length > 0 && shown.length === 0 && <Text fz="sm">{t("datasets.noMatch", { search })}</Text>}
        {shown.length > 0 && (
          <DataTable
            testId="datasets"
            highlight
            rows={shown}
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
