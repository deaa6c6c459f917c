import { Button, FileButton, Stack, Table, Text } from "@mantine/core";
import { useInfiniteQuery } from "@tanstack/react-query";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { Link } from "react-router";
import { api, must } from "@/shared/api/client";
import { Empty } from "@/shared/ui/Empty";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { StatusBadge } from "@/shared/ui/StatusBadge";
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
  const rows = datasets.data?.pages.flatMap((page) => page.items) ?? [];
  return (
    <div className="page">
      <PageHead title={t("nav.datasets")} doc={t("datasets.doc")}>
        <FileButton onChange={setFile}>
          {(props) => <Button {...props}>{t("datasets.import")}</Button>}
        </FileButton>
      </PageHead>
      <Stack gap="md">
        <ProblemAlert error={datasets.error} onRetry={() => void datasets.refetch()} />
        {file && <UploadPanel key={`${file.name}${file.lastModified}`} file={file} onClose={() => setFile(null)} />}
        {datasets.isSuccess && rows.length === 0 && !file && <Empty title={t("datasets.none")}>{t("datasets.noneDoc")}</Empty>}
        {rows.length > 0 && (
          <Table highlightOnHover>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>{t("systems.name")}</Table.Th>
                <Table.Th>{t("importing.format")}</Table.Th>
                <Table.Th>{t("jobs.status")}</Table.Th>
                <Table.Th>{t("datasets.kept")}</Table.Th>
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {rows.map((row) => (
                <Table.Tr key={row.id}>
                  <Table.Td>
                    <Text component={Link} to={`/datasets/${row.id}`} c="var(--mantine-color-anchor)" fz="sm" fw={500}>
                      {row.name}
                    </Text>
                  </Table.Td>
                  <Table.Td>{t(`importing.formats.${row.format}`, row.format)}</Table.Td>
                  <Table.Td>
                    <StatusBadge status={row.status} />
                  </Table.Td>
                  <Table.Td>
                    <When at={row.created_at} />
                  </Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
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
