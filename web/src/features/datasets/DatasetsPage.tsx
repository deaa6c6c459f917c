import { Button, Checkbox, FileButton, Group, NativeSelect, NumberInput, Paper, Progress, Stack, Table, Text, TextInput, Title } from "@mantine/core";
import { useInfiniteQuery, useQueryClient } from "@tanstack/react-query";
import { useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import { Link, useNavigate } from "react-router";
import { api, must } from "@/shared/api/client";
import { Empty } from "@/shared/ui/Empty";
import { NumberEntry } from "@/shared/ui/NumberEntry";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { StatusBadge } from "@/shared/ui/StatusBadge";
import { When } from "@/shared/ui/When";
import { cellsOf, columnsOf, guessLayout, rateOf, type Column, type Layout } from "./preview";
import { interrupted, upload } from "./upload";

/** Recordings: what is there, and the way in for text files. */
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
        <FileButton accept=".csv,.txt,.tsv,.dat,text/*" onChange={setFile}>
          {(props) => <Button {...props}>{t("datasets.import")}</Button>}
        </FileButton>
      </PageHead>
      <Stack gap="md">
        <ProblemAlert error={datasets.error} onRetry={() => void datasets.refetch()} />
        {file && <Import key={`${file.name}${file.lastModified}`} file={file} onClose={() => setFile(null)} />}
        {datasets.isSuccess && rows.length === 0 && !file && <Empty title={t("datasets.none")}>{t("datasets.noneDoc")}</Empty>}
        {rows.length > 0 && (
          <Table highlightOnHover>
            <Table.Thead>
              <Table.Tr>
                <Table.Th>{t("systems.name")}</Table.Th>
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

const PREVIEWED = 64 << 10;

function Import({ file, onClose }: { file: File; onClose(): void }) {
  const { t } = useTranslation();
  const navigate = useNavigate();
  const queries = useQueryClient();
  const [lines, setLines] = useState<string[] | null>(null);
  const [layout, setLayout] = useState<Layout>({ delimiter: ",", decimal: ".", header_lines: 0 });
  const [columns, setColumns] = useState<Column[]>([]);
  const [rate, setRate] = useState<number | undefined>(undefined);
  const [name, setName] = useState(file.name.replace(/\.[^.]*$/, ""));
  const [sent, setSent] = useState<number | null>(null);
  const [failure, setFailure] = useState<unknown>(null);
  const abort = useRef<AbortController | null>(null);
  const arrange = (read: string[], next: Layout) => {
    setLayout(next);
    const found = columnsOf(read, next);
    const clock = found.find((column) => rateOf(read, next, column.index) !== null && /^(t|time)/.test(column.name));
    setColumns(found.map((column) => ({ ...column, take: column !== clock })));
    if (clock) setRate(rateOf(read, next, clock.index) ?? undefined);
  };
  if (lines === null) {
    void file.slice(0, PREVIEWED).text().then((text) => {
      const read = text.split(/\r?\n/).slice(0, file.size > PREVIEWED ? -1 : undefined).filter((line, i, all) => line !== "" || i < all.length - 1).slice(0, 200);
      setLines(read);
      arrange(read, guessLayout(read));
    });
    return null;
  }
  const start = async () => {
    setFailure(null);
    setSent(0);
    abort.current = new AbortController();
    const taken = columns.filter((column) => column.take);
    const request = { name, format: "txt", import: { ...layout, sample_rate: rate, columns: taken.map(({ index, name: own, unit, scale }) => ({ index, name: own, unit, scale })) } };
    try {
      const id = await upload(file, request, setSent, abort.current.signal);
      await queries.invalidateQueries({ queryKey: ["datasets"] });
      void navigate(`/datasets/${id}`);
    } catch (error) {
      if (!(error instanceof DOMException)) setFailure(error);
      setSent(null);
    }
  };
  const column = (index: number, part: Partial<Column>) => setColumns((before) => before.map((c) => (c.index === index ? { ...c, ...part } : c)));
  return (
    <Paper withBorder p="md" data-testid="import">
      <Title order={2} mb="xs">
        {t("datasets.importOf", { name: file.name })}
      </Title>
      <Group align="flex-end" mb="sm">
        <TextInput label={t("systems.name")} value={name} onChange={(event) => setName(event.currentTarget.value)} w={240} />
        <NativeSelect
          size="xs"
          label={t("datasets.delimiter")}
          value={layout.delimiter}
          data={[
            { value: "\t", label: t("datasets.tab") },
            { value: ";", label: ";" },
            { value: ",", label: "," },
            { value: " ", label: t("datasets.space") },
          ]}
          onChange={(event) => arrange(lines, { ...layout, delimiter: event.currentTarget.value })}
        />
        <NativeSelect size="xs" label={t("datasets.decimal")} value={layout.decimal} data={[".", ","]} onChange={(event) => arrange(lines, { ...layout, decimal: event.currentTarget.value as "." | "," })} />
        <NumberInput size="xs" label={t("datasets.header")} min={0} max={190} value={layout.header_lines} onChange={(value) => arrange(lines, { ...layout, header_lines: Number(value) || 0 })} w={110} hideControls />
        <NumberEntry label={t("datasets.rate")} unit="1/s" value={rate} optional onCommit={(value) => setRate(typeof value === "number" && value > 0 ? value : undefined)} w={140} />
      </Group>
      <Table.ScrollContainer minWidth={520}>
        <Table>
          <Table.Thead>
            <Table.Tr>
              <Table.Th>{t("datasets.take")}</Table.Th>
              <Table.Th>{t("datasets.channel")}</Table.Th>
              <Table.Th>{t("jobs.unit")}</Table.Th>
              <Table.Th>{t("datasets.scale")}</Table.Th>
              <Table.Th>{t("datasets.first")}</Table.Th>
            </Table.Tr>
          </Table.Thead>
          <Table.Tbody>
            {columns.map((c) => (
              <Table.Tr key={c.index}>
                <Table.Td>
                  <Checkbox size="xs" checked={c.take} onChange={(event) => column(c.index, { take: event.currentTarget.checked })} aria-label={t("datasets.takeOf", { name: c.name })} />
                </Table.Td>
                <Table.Td>
                  <TextInput aria-label={t("datasets.nameOf", { number: c.index + 1 })} value={c.name} onChange={(event) => column(c.index, { name: event.currentTarget.value })} w={160} />
                </Table.Td>
                <Table.Td>
                  <TextInput aria-label={t("datasets.unitOf", { number: c.index + 1 })} value={c.unit} onChange={(event) => column(c.index, { unit: event.currentTarget.value })} w={100} />
                </Table.Td>
                <Table.Td>
                  <NumberEntry aria-label={t("datasets.scaleOf", { number: c.index + 1 })} value={c.scale} onCommit={(value) => typeof value === "number" && column(c.index, { scale: value })} w={100} />
                </Table.Td>
                <Table.Td className="numbers">
                  {cellsOf(lines, layout, 3)
                    .map((cells) => cells[c.index])
                    .join("   ")}
                </Table.Td>
              </Table.Tr>
            ))}
          </Table.Tbody>
        </Table>
      </Table.ScrollContainer>
      <ProblemAlert error={failure} />
      {sent !== null && <Progress value={100 * sent} aria-label={t("datasets.sent")} my="sm" />}
      {interrupted(file) && sent === null && (
        <Text fz="sm" my="xs" role="status">
          {t("datasets.interrupted")}
        </Text>
      )}
      <Group mt="sm">
        <Button onClick={() => void start()} disabled={sent !== null || rate === undefined || !columns.some((c) => c.take) || name === ""}>
          {interrupted(file) ? t("datasets.resume") : t("datasets.send")}
        </Button>
        <Button variant="default" onClick={() => (sent === null ? onClose() : abort.current?.abort())}>
          {sent === null ? t("datasets.close") : t("datasets.stop")}
        </Button>
        {rate === undefined && <Text fz="sm">{t("datasets.needRate")}</Text>}
      </Group>
    </Paper>
  );
}
