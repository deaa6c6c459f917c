import { ActionIcon, Badge, Button, Card, FileButton, Group, Menu, SimpleGrid, Stack, Table, Text, TextInput, Title } from "@mantine/core";
import { useInfiniteQuery, useMutation, useQueryClient } from "@tanstack/react-query";
import { useEffect, useState } from "react";
import { useTranslation } from "react-i18next";
import { Link, useNavigate, useSearchParams } from "react-router";
import type { SystemDocument } from "@/shared/api/types";
import { Problem } from "@/shared/api/problem";
import { download, fileName } from "@/shared/plots/export";
import { Empty } from "@/shared/ui/Empty";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { useAsked } from "@/shared/ui/useAsked";
import { When } from "@/shared/ui/When";
import { createSystem, deleteSystem, systemQuery, systemsKey, systemsQuery } from "@/shared/api/systems";
import { useTour } from "@/shared/tour/tour";
import type { Template } from "./templates";
import { TourOffer } from "./TourOffer";

/** The smallest system that is one: it answers its command with a lag. */
const FIRST: SystemDocument = {
  blocks: { reference: { kind: "input" }, plant: { kind: "transfer_function", numerator: [1], denominator: [0.1, 1] } },
  connections: [{ from: "reference", to: "plant" }],
  outputs: { y: "plant" },
};

export function SystemsPage() {
  const { t } = useTranslation();
  const navigate = useNavigate();
  const queries = useQueryClient();
  const [query, setQuery] = useSearchParams();
  const search = query.get("q") ?? "";
  const asked = useAsked(search);
  const systems = useInfiniteQuery(systemsQuery(asked));
  const create = useMutation({
    mutationFn: ({ document }: { document: SystemDocument; to: string; tour?: boolean }) => createSystem(document),
    onSuccess: (id, { to, tour }) => {
      if (tour) useTour.getState().go("panel", id);
      void queries.invalidateQueries({ queryKey: systemsKey });
      void navigate(`/systems/${id}/${to}`);
    },
  });
  const copy = useMutation({
    mutationFn: async (id: string) => {
      const found = await queries.fetchQuery(systemQuery(id));
      return createSystem({ ...found.document, name: t("systems.copyOf", { name: found.document.name || id }).slice(0, 200) });
    },
    onSuccess: () => queries.invalidateQueries({ queryKey: systemsKey }),
  });
  const remove = useMutation({
    mutationFn: ({ id, revision }: { id: string; revision: number }) => deleteSystem(id, revision),
    onSuccess: () => queries.invalidateQueries({ queryKey: systemsKey }),
  });
  const read = useMutation({
    mutationFn: async (file: File) => {
      let document: SystemDocument;
      try {
        document = JSON.parse(await file.text()) as SystemDocument;
      } catch {
        throw new Problem({ status: 0, title: "", detail: t("systems.noJson", { name: file.name }) });
      }
      return createSystem(document);
    },
    onSuccess: (id) => {
      void queries.invalidateQueries({ queryKey: systemsKey });
      void navigate(`/systems/${id}/diagram`);
    },
  });
  const exportOne = async (id: string) => {
    const found = await queries.fetchQuery(systemQuery(id));
    download(fileName(found.document.name || id, "json"), new Blob([JSON.stringify(found.document, null, 2) + "\n"], { type: "application/json" }));
  };
  const all = systems.data?.pages.flatMap((page) => page.items) ?? [];
  const none = systems.isSuccess && !systems.isPlaceholderData && all.length === 0;
  const empty = none && asked === "";

  return (
    <div className="page">
      <PageHead title={t("nav.systems")} doc={t("systems.doc")}>
        <FileButton accept="application/json,.json" onChange={(file) => file && read.mutate(file)}>
          {(props) => (
            <Button variant="default" {...props} aria-describedby={read.error ? "import-problem" : undefined}>
              {t("systems.import")}
            </Button>
          )}
        </FileButton>
        <Button onClick={() => create.mutate({ document: { ...FIRST, name: t("systems.newName") }, to: "diagram" })} loading={create.isPending}>
          {t("systems.new")}
        </Button>
      </PageHead>
      <Stack gap="lg">
        <TourOffer onOpen={(template) => create.mutate({ document: template.document, to: `panel?${template.panel}`, tour: true })} busy={create.isPending} />
        <ProblemAlert error={create.error ?? copy.error ?? remove.error ?? systems.error} />
        <ProblemAlert id="import-problem" error={read.error} />
        {empty && (
          <Empty
            title={t("systems.none")}
            action={
              <Button component={Link} to={{ hash: "templates", search: query.toString() }}>
                {t("systems.toTemplates")}
              </Button>
            }
          >
            {t("systems.noneDoc")}
          </Empty>
        )}
        {systems.isSuccess && !empty && (
          <div>
            <TextInput label={t("systems.search")} value={search} onChange={(event) => setQuery(event.currentTarget.value ? { q: event.currentTarget.value } : {}, { replace: true, preventScrollReset: true })} maw={320} mb="xs" type="search" />
            <Table.ScrollContainer minWidth={560}>
              <Table highlightOnHover>
                <Table.Thead>
                  <Table.Tr>
                    <Table.Th>{t("systems.name")}</Table.Th>
                    <Table.Th>{t("systems.revision")}</Table.Th>
                    <Table.Th>{t("systems.changed")}</Table.Th>
                    <Table.Th aria-label={t("systems.actions")} />
                  </Table.Tr>
                </Table.Thead>
                <Table.Tbody>
                  {all.map((row) => (
                    <Table.Tr key={row.id}>
                      <Table.Td>
                        <Text component={Link} to={`/systems/${row.id}/panel`} c="var(--mantine-color-anchor)" fw={500} fz="sm">
                          {row.name || row.id}
                        </Text>
                      </Table.Td>
                      <Table.Td className="numbers">{row.revision}</Table.Td>
                      <Table.Td>
                        <When at={row.updated_at} />
                      </Table.Td>
                      <Table.Td ta="right">
                        <Menu position="bottom-end">
                          <Menu.Target>
                            <ActionIcon variant="subtle" color="gray" aria-label={t("systems.more", { name: row.name || row.id })}>
                              ⋯
                            </ActionIcon>
                          </Menu.Target>
                          <Menu.Dropdown>
                            <Menu.Item component={Link} to={`/systems/${row.id}/diagram`}>
                              {t("system.diagram")}
                            </Menu.Item>
                            <Menu.Item onClick={() => copy.mutate(row.id)}>{t("systems.duplicate")}</Menu.Item>
                            <Menu.Item onClick={() => void exportOne(row.id)}>{t("systems.export")}</Menu.Item>
                            <Menu.Item color="red" onClick={() => remove.mutate({ id: row.id, revision: row.revision })}>
                              {t("systems.delete")}
                            </Menu.Item>
                          </Menu.Dropdown>
                        </Menu>
                      </Table.Td>
                    </Table.Tr>
                  ))}
                </Table.Tbody>
              </Table>
            </Table.ScrollContainer>
            {none && <Text fz="sm">{t("systems.noMatch", { search: asked })}</Text>}
            {systems.hasNextPage && (
              <Button variant="default" onClick={() => void systems.fetchNextPage()} loading={systems.isFetchingNextPage}>
                {t("systems.further")}
              </Button>
            )}
          </div>
        )}
        {/* below the list, whose height is not known before it is there */}
        {!systems.isPending && (
          <Templates onOpen={(template) => create.mutate({ document: template.document, to: `panel?${template.panel}` })} busy={create.isPending} />
        )}
      </Stack>
    </div>
  );
}

function Templates({ onOpen, busy }: { onOpen: (template: Template) => void; busy: boolean }) {
  const { t } = useTranslation();
  const [listed, setListed] = useState<Template[]>([]);
  useEffect(() => void import("./templates").then((found) => setListed(found.templates)), []);
  return (
    <section aria-labelledby="templates">
      <Title order={2} id="templates" mb={4}>
        {t("systems.templates")}
      </Title>
      <Text fz="sm" c="dimmed" mb="sm">
        {t("systems.templatesDoc")}
      </Text>
      <SimpleGrid cols={{ base: 1, xs: 2, md: 3, lg: 4 }} spacing="sm" mih={320}>
        {listed.map((template) => (
          <Card key={template.id} withBorder padding="sm" component="article">
            <Stack gap={6} h="100%" justify="space-between">
              <div>
                <Title order={3}>{t(`templates.${template.id}.title`)}</Title>
                <Text fz="xs" c="dimmed">
                  {t(`templates.${template.id}.doc`)}
                </Text>
              </div>
              <Group justify="space-between">
                <Badge variant="outline" color="gray" tt="none" fw={400}>
                  {t("systems.blocks", { count: Object.keys(template.document.blocks).length })}
                </Badge>
                <Button variant="light" onClick={() => onOpen(template)} disabled={busy} aria-label={t("systems.openTemplate", { name: t(`templates.${template.id}.title`) })}>
                  {t("systems.open")}
                </Button>
              </Group>
            </Stack>
          </Card>
        ))}
      </SimpleGrid>
    </section>
  );
}
