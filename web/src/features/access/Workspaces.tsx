import { Button, Group, Text, TextInput, Title } from "@mantine/core";
import { useMutation, useQuery, useQueryClient } from "@tanstack/react-query";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { useSearchParams } from "react-router";
import { api, must } from "@/shared/api/client";
import { isProblem } from "@/shared/api/problem";
import { DataTable } from "@/shared/ui/DataTable";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { When } from "@/shared/ui/When";
import { workspaceQuery, workspacesQuery, type WorkspaceHead } from "./api";
import { Quotas } from "./Quotas";

/** The workspaces that the key may see, a way to make another one, and the quotas of the one that the address names. */
export function Workspaces({ workspaces }: { workspaces: WorkspaceHead[] }) {
  const { t } = useTranslation();
  const queries = useQueryClient();
  const [query, setQuery] = useSearchParams();
  const [name, setName] = useState("");
  const chosen = query.get("workspace") ?? workspaces[0]?.id ?? "";
  const look = (id: string) => setQuery({ workspace: id }, { replace: true, preventScrollReset: true });
  const found = useQuery({ ...workspaceQuery(chosen), enabled: chosen !== "" });
  const create = useMutation({
    mutationFn: () => must(api.POST("/v1/workspaces", { body: { name } })),
    onSuccess: async (made) => {
      setName("");
      await queries.invalidateQueries({ queryKey: workspacesQuery.queryKey });
      look(made.id);
    },
  });
  return (
    <section>
      <Title order={2} mb="xs">
        {t("access.workspaces")}
      </Title>
      <Text fz="xs" c="dimmed" mb="xs">
        {t("access.workspacesDoc")}
      </Text>
      <form
        onSubmit={(event) => {
          event.preventDefault();
          create.mutate();
        }}
      >
        <Group align="flex-end" mb="sm">
          <TextInput label={t("access.newWorkspace")} value={name} onChange={(event) => setName(event.currentTarget.value)} error={isProblem(create.error) ? create.error.at("/name") : undefined} w={260} />
          <Button type="submit" variant="default" disabled={name.trim() === ""} loading={create.isPending}>
            {t("access.makeWorkspace")}
          </Button>
        </Group>
        <ProblemAlert error={create.error} shown={["/name"]} />
      </form>
      <DataTable
        testId="workspaces"
        minWidth={480}
        maxWidth={760}
        rows={workspaces}
        keyOf={(row) => row.id}
        columns={[
          { title: t("access.name"), cell: (row) => row.name },
          { title: t("access.identifier"), cell: (row) => <span className="numbers">{row.id}</span> },
          { title: t("revisions.made"), cell: (row) => <When at={row.created_at} /> },
          {
            title: "",
            cell: (row) => (
              <Button size="compact-xs" variant={row.id === chosen ? "light" : "subtle"} aria-pressed={row.id === chosen} onClick={() => look(row.id)} aria-label={t("access.quotasOf", { name: row.name })}>
                {t("access.quotas")}
              </Button>
            ),
          },
        ]}
      />
      <ProblemAlert error={found.error} onRetry={() => void found.refetch()} />
      {found.data && <Quotas key={`${found.data.id}.${found.data.revision}`} workspace={found.data} etag={found.data.etag} />}
    </section>
  );
}
