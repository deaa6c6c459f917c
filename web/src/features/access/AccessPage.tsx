import { Alert, Button, Checkbox, Code, CopyButton, Group, Stack, Table, Text, TextInput, Title } from "@mantine/core";
import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { api, must } from "@/shared/api/client";
import { isProblem, Problem } from "@/shared/api/problem";
import { Empty } from "@/shared/ui/Empty";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { When } from "@/shared/ui/When";

const SCOPES = ["read", "write", "run", "acquire", "admin"] as const;
type Scope = (typeof SCOPES)[number];

/** Keys of the workspace, and for those who run the installation its workspaces. */
export function AccessPage() {
  const { t } = useTranslation();
  const queries = useQueryClient();
  const keys = useQuery({ queryKey: ["keys"], retry: false, queryFn: () => must(api.GET("/v1/keys", { params: { query: { limit: 500 } } })) });
  const workspaces = useQuery({ queryKey: ["workspaces"], retry: false, queryFn: () => must(api.GET("/v1/workspaces", { params: { query: { limit: 500 } } })) });
  const [name, setName] = useState("");
  const [scopes, setScopes] = useState<Scope[]>(["read"]);
  const create = useMutation({
    mutationFn: () => must(api.POST("/v1/keys", { body: { name, scopes } })),
    onSuccess: () => {
      setName("");
      void queries.invalidateQueries({ queryKey: ["keys"] });
    },
  });
  const revoke = useMutation({
    mutationFn: (identifier: string) => must(api.DELETE("/v1/keys/{identifier}", { params: { path: { identifier } } })),
    onSuccess: () => queries.invalidateQueries({ queryKey: ["keys"] }),
  });
  const problem = create.error instanceof Problem ? create.error : null;
  if (isProblem(keys.error, 403)) {
    return (
      <div className="page">
        <PageHead title={t("nav.access")} />
        <Empty title={t("access.closed")}>{keys.error.message}</Empty>
      </div>
    );
  }
  return (
    <div className="page">
      <PageHead title={t("nav.access")} doc={t("access.doc")} />
      <Stack gap="lg">
        <ProblemAlert error={keys.error ?? revoke.error} />
        <form
          onSubmit={(event) => {
            event.preventDefault();
            create.mutate();
          }}
        >
          <Group align="flex-end" gap="md">
            <TextInput label={t("access.name")} value={name} onChange={(event) => setName(event.currentTarget.value)} error={problem?.at("/name")} w={220} />
            <Checkbox.Group label={t("access.may")} value={scopes} onChange={(value) => setScopes(value as Scope[])} error={problem?.at("/scopes")}>
              <Group gap="md" mt={4}>
                {SCOPES.map((scope) => (
                  <Checkbox key={scope} value={scope} label={t(`access.scopes.${scope}`)} size="xs" />
                ))}
              </Group>
            </Checkbox.Group>
            <Button type="submit" disabled={name === "" || scopes.length === 0} loading={create.isPending}>
              {t("access.make")}
            </Button>
          </Group>
          <ProblemAlert error={create.error} shown={["/name", "/scopes"]} />
        </form>
        {create.data?.key && (
          <Alert color="green" variant="outline" title={t("access.once")}>
            <Group>
              <Code data-testid="new-key">{create.data.key}</Code>
              <CopyButton value={create.data.key}>{({ copied, copy }) => <Button variant="default" onClick={copy}>{copied ? t("optimise.copied") : t("access.copy")}</Button>}</CopyButton>
            </Group>
          </Alert>
        )}
        <Table.ScrollContainer minWidth={640}>
          <Table data-testid="keys">
            <Table.Thead>
              <Table.Tr>
                <Table.Th>{t("access.name")}</Table.Th>
                <Table.Th>{t("access.begins")}</Table.Th>
                <Table.Th>{t("access.may")}</Table.Th>
                <Table.Th>{t("access.used")}</Table.Th>
                <Table.Th>{t("access.ends")}</Table.Th>
                <Table.Th aria-label={t("systems.actions")} />
              </Table.Tr>
            </Table.Thead>
            <Table.Tbody>
              {(keys.data?.items ?? []).map((key) => (
                <Table.Tr key={key.id}>
                  <Table.Td>{key.name}</Table.Td>
                  <Table.Td className="numbers">{key.prefix}…</Table.Td>
                  <Table.Td>{key.scopes.map((scope) => t(`access.scopes.${scope}`)).join(", ")}</Table.Td>
                  <Table.Td>
                    <When at={key.last_used_at} />
                  </Table.Td>
                  <Table.Td>{key.revoked_at ? t("access.revoked") : <When at={key.expires_at} />}</Table.Td>
                  <Table.Td ta="right">
                    {!key.revoked_at && (
                      <Button variant="subtle" color="red" size="compact-xs" onClick={() => revoke.mutate(key.id)} aria-label={t("access.revokeOf", { name: key.name })}>
                        {t("access.revoke")}
                      </Button>
                    )}
                  </Table.Td>
                </Table.Tr>
              ))}
            </Table.Tbody>
          </Table>
        </Table.ScrollContainer>
        {workspaces.data && (
          <section>
            <Title order={2} mb="xs">
              {t("access.workspaces")}
            </Title>
            <Table maw={640}>
              <Table.Tbody>
                {workspaces.data.items.map((row) => (
                  <Table.Tr key={row.id}>
                    <Table.Td>{row.name}</Table.Td>
                    <Table.Td className="numbers">{row.id}</Table.Td>
                    <Table.Td>
                      <When at={row.created_at} />
                    </Table.Td>
                  </Table.Tr>
                ))}
              </Table.Tbody>
            </Table>
            <Text fz="xs" c="dimmed" mt="xs">
              {t("access.workspacesDoc")}
            </Text>
          </section>
        )}
      </Stack>
    </div>
  );
}
