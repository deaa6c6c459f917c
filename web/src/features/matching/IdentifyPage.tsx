import { NativeSelect, Paper, Stack, Text } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { PageHead } from "@/shared/ui/PageHead";
import { useQueryText } from "@/shared/ui/useQueryText";
import { DirectForm } from "./DirectForm";
import { METHODS, methodIn } from "./direct";
import { GreyBoxForm } from "./GreyBoxForm";
import { useMatch } from "./MatchFields";

/** What is sought in recordings, and how; a worker seeks it, and the page of its job shows how it goes and what it found. */
export function IdentifyPage() {
  const { t } = useTranslation();
  const [query, setQuery] = useQueryText();
  const method = methodIn(query);
  const choose = (next: string) =>
    setQuery((before) => {
      const kept = new URLSearchParams([...before].filter(([key]) => key !== "method" && key !== "f"));
      if (next !== "grey_box") kept.set("method", next);
      return kept;
    });
  return (
    <div className="page">
      <PageHead title={t("matching.identify")} doc={t("matching.identifyDoc")} />
      <Paper withBorder p="md" maw={900}>
        <Stack gap="sm">
          <NativeSelect size="xs" maw={420} label={t("matching.method")} value={method} onChange={(event) => choose(event.currentTarget.value)} data={METHODS.map((value) => ({ value, label: t(`matching.methods.${value}`) }))} />
          <Text fz="xs" c="dimmed">
            {t(`matching.methodDocs.${method}`)}
          </Text>
          {method === "grey_box" ? <GreyBox /> : <DirectForm key={method} method={method} />}
        </Stack>
      </Paper>
    </div>
  );
}

function GreyBox() {
  const found = useMatch();
  return <GreyBoxForm key={found.opened?.system?.id ?? "none"} found={found} />;
}
