import { Button, Group, NativeSelect, Paper, Progress, Text, TextInput, Title } from "@mantine/core";
import { useQueryClient } from "@tanstack/react-query";
import { useRef, useState } from "react";
import { useTranslation } from "react-i18next";
import { useNavigate } from "react-router";
import { isProblem } from "@/shared/api/problem";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { formatNumber } from "@/shared/units/format";
import { FORMATS, type Format } from "./importing";
import { interrupted, upload } from "./upload";

/** A file on its way: sent in verified pieces, and taken up again where it broke off; what it holds is said on the next page. */
export function UploadPanel({ file, onClose }: { file: File; onClose(): void }) {
  const { t } = useTranslation();
  const navigate = useNavigate();
  const queries = useQueryClient();
  const [name, setName] = useState(file.name.replace(/\.[^.]*$/, ""));
  const [format, setFormat] = useState<Format | "">("");
  const [sent, setSent] = useState<number | null>(null);
  const [failure, setFailure] = useState<unknown>(null);
  const abort = useRef<AbortController | null>(null);
  const known = interrupted(file) !== null;
  const start = async () => {
    setFailure(null);
    setSent(0);
    abort.current = new AbortController();
    try {
      const id = await upload(file, { name, file: file.name, ...(format ? { format } : {}), origin: { file: file.name } }, setSent, abort.current.signal);
      await queries.invalidateQueries({ queryKey: ["datasets"] });
      void navigate(`/datasets/${id}/import`);
    } catch (error) {
      if (!(error instanceof DOMException && error.name === "AbortError")) setFailure(error);
      setSent(null);
    }
  };
  return (
    <Paper withBorder p="md" data-testid="upload">
      <Title order={2} mb="xs">
        {t("datasets.importOf", { name: file.name })}
      </Title>
      <Group align="flex-start">
        <TextInput label={t("systems.name")} value={name} onChange={(event) => setName(event.currentTarget.value)} w={260} disabled={known} error={isProblem(failure) ? failure.at("/name") : undefined} />
        <NativeSelect size="xs" label={t("importing.format")} value={format} onChange={(event) => setFormat(event.currentTarget.value as Format | "")} data={[{ value: "", label: t("importing.formats.unknown") }, ...FORMATS.map((value) => ({ value, label: t(`importing.formats.${value}`) }))]} disabled={known} error={isProblem(failure) ? failure.at("/format") : undefined} />
        <Text fz="sm" pt={26}>
          {formatNumber(file.size / 1e6, 3)} MB
        </Text>
      </Group>
      <ProblemAlert error={failure} shown={["/name", "/format"]} />
      {sent !== null && <Progress value={100 * sent} aria-label={t("datasets.sent")} my="sm" />}
      {known && sent === null && (
        <Text fz="sm" my="xs" role="status">
          {t("datasets.interrupted")}
        </Text>
      )}
      <Group mt="sm">
        <Button onClick={() => void start()} disabled={sent !== null || name.trim() === "" || file.size === 0}>
          {known ? t("datasets.resume") : t("importing.send")}
        </Button>
        <Button variant="default" onClick={() => (sent === null ? onClose() : abort.current?.abort())}>
          {sent === null ? t("datasets.close") : t("datasets.stop")}
        </Button>
      </Group>
    </Paper>
  );
}
