import { Box, Group, Stack, Text, Title } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { When } from "@/shared/ui/When";
import type { Finding, RigDocument } from "./api";
import { hardwareOf, worst, type Tried } from "./devices";
import { Mark } from "./Mark";

/** The devices of a rig, their channels below them, and in words what does not fit. */
export function Hardware({ document }: { document: RigDocument }) {
  const { t } = useTranslation();
  const { branches, others } = hardwareOf(document);
  const findings = document.findings ?? [];
  return (
    <section>
      <Group justify="space-between" mb="xs">
        <Title order={2}>{t("rigs.hardware")}</Title>
        <Group gap="xs">
          {(["fails", "note", "ok"] as const).map((result) => {
            const count = findings.filter((finding) => finding.result === result).length;
            return count > 0 && <Mark key={result} result={result} text={t(`rigs.findings.${result}`, { count })} />;
          })}
          {document.checked_at && (
            <Text fz="xs" c="dimmed">
              {t("rigs.checked")} <When at={document.checked_at} />
            </Text>
          )}
        </Group>
      </Group>
      <Box component="ul" m={0} p={0} style={{ listStyle: "none" }} data-testid="hardware">
        {others.map((finding) => (
          <Item key={finding.what} tried={{ name: finding.what, doc: "", findings: [finding] }} />
        ))}
        {branches.map((branch) => (
          <Item key={branch.name} tried={branch}>
            <Box component="ul" m={0} pl="xl" style={{ listStyle: "none" }}>
              {branch.channels.map((channel) => (
                <Item key={`${channel.name} ${channel.doc}`} tried={channel} />
              ))}
            </Box>
          </Item>
        ))}
      </Box>
      {findings.length === 0 && <Text fz="sm">{t("rigs.notChecked")}</Text>}
    </section>
  );
}

function Item({ tried, children }: { tried: Tried; children?: React.ReactNode }) {
  const { t } = useTranslation();
  const result = worst(tried.findings);
  return (
    <Box component="li" py={4}>
      <Group gap="sm" align="flex-start" wrap="nowrap">
        <Mark result={result} label={t(`rigs.found.${result ?? "untried"}`)} />
        <Stack gap={0} miw={0}>
          <Text fz="sm">
            <Text span fw={500} fz="sm">
              {tried.name}
            </Text>{" "}
            <Text span fz="xs" c="dimmed" className="numbers">
              {result === "ok" ? tried.findings.map((finding) => finding.told).join("; ") : tried.doc}
            </Text>
          </Text>
          {result !== "ok" && tried.findings.map((finding) => <Told key={finding.told} finding={finding} />)}
        </Stack>
      </Group>
      {children}
    </Box>
  );
}

function Told({ finding: { told, remedy } }: { finding: Finding }) {
  return (
    <Text fz="xs" style={{ overflowWrap: "anywhere" }}>
      {told}
      {remedy && (
        <>
          {" "}
          <Text span fz="xs" fw={600}>
            → {remedy}
          </Text>
        </>
      )}
    </Text>
  );
}
