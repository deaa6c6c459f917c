import { Anchor, Badge, Group, Stack, Table, Text, Title } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useTranslation } from "react-i18next";
import { api, must } from "@/shared/api/client";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";

const PARTS = ["React", "Mantine", "React Flow", "elkjs (EPL-2.0)", "uPlot", "TanStack Query", "zustand", "i18next", "openapi-fetch"];

/** Whether everything is well, which version this is, and what it is made of. */
export function AboutPage() {
  const { t } = useTranslation();
  const ready = useQuery({ queryKey: ["ready"], refetchInterval: 10_000, queryFn: () => must(api.GET("/readyz")) });
  const version = useQuery({
    queryKey: ["version"],
    staleTime: Infinity,
    queryFn: async () => ((await (await fetch("/openapi.json")).json()) as { info: { version: string } }).info.version,
  });
  return (
    <div className="page">
      <PageHead title={t("nav.about")} doc={t("about.doc")} />
      <Stack gap="lg" display={ready.isPending ? "none" : undefined}>
        <ProblemAlert error={ready.error} onRetry={() => void ready.refetch()} />
        <section>
          <Title order={2} mb="xs">
            {t("about.state")}
          </Title>
          <Table maw={480} data-testid="checks">
            <Table.Tbody>
              <Table.Tr>
                <Table.Td>{t("about.version")}</Table.Td>
                <Table.Td className="numbers">{version.data}</Table.Td>
              </Table.Tr>
              {Object.entries(ready.data?.checks ?? {}).map(([name, state]) => (
                <Table.Tr key={name}>
                  <Table.Td>{t(`about.checks.${name}`, name)}</Table.Td>
                  <Table.Td>
                    <Badge variant="outline" color={state === "ok" ? "green" : "orange"} tt="none" c="var(--ink)">
                      {t(`about.states.${state}`, state)}
                    </Badge>
                  </Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        </section>
        <section>
          <Title order={2} mb="xs">
            {t("about.interface")}
          </Title>
          <Group gap="md">
            <Anchor href="/docs/" fz="sm">
              {t("about.documentation")}
            </Anchor>
            <Anchor href="/docs/api" fz="sm">
              {t("about.reference")}
            </Anchor>
            <Anchor href="/openapi.json" fz="sm">
              OpenAPI
            </Anchor>
          </Group>
        </section>
        <section>
          <Title order={2} mb="xs">
            {t("about.parts")}
          </Title>
          <Text fz="sm">{PARTS.join(" · ")}</Text>
        </section>
      </Stack>
    </div>
  );
}
