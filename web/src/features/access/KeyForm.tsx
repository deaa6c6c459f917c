import { Button, Checkbox, Group, NativeSelect, TextInput } from "@mantine/core";
import { useMutation, useQueryClient } from "@tanstack/react-query";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { api, must } from "@/shared/api/client";
import { isProblem } from "@/shared/api/problem";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { keysQuery, SCOPES, type NewKey, type Scope, type WorkspaceHead } from "./api";

/** A new key: for whom, what it may, until when, and, for those who run the installation, in which workspace. */
export function KeyForm({ workspaces, onMade }: { workspaces: WorkspaceHead[]; onMade(made: NewKey): void }) {
  const { t } = useTranslation();
  const queries = useQueryClient();
  const [name, setName] = useState("");
  const [scopes, setScopes] = useState<Scope[]>(["read"]);
  const [until, setUntil] = useState("");
  const [workspace, setWorkspace] = useState("");
  const create = useMutation({
    mutationFn: () => must(api.POST("/v1/keys", { body: { name, scopes, ...(until ? { expires_at: `${until}T00:00:00Z` } : {}), ...(workspace ? { workspace } : {}) } })),
    onSuccess: (made) => {
      setName("");
      onMade(made);
      return queries.invalidateQueries({ queryKey: keysQuery.queryKey });
    },
  });
  const problem = isProblem(create.error) ? create.error : null;
  return (
    <form
      onSubmit={(event) => {
        event.preventDefault();
        create.mutate();
      }}
    >
      <Group align="flex-end" gap="md">
        <TextInput label={t("access.name")} value={name} onChange={(event) => setName(event.currentTarget.value)} error={problem?.at("/name")} w={220} />
        <Checkbox.Group label={t("access.may")} value={scopes} onChange={(value) => setScopes(value as Scope[])} error={problem?.at("/scopes")}>
          <Group gap="md" mih={30}>
            {SCOPES.map((scope) => (
              <Checkbox key={scope} value={scope} label={t(`access.scopes.${scope}`)} size="xs" />
            ))}
          </Group>
        </Checkbox.Group>
        <TextInput type="date" label={t("access.until")} value={until} onChange={(event) => setUntil(event.currentTarget.value)} error={problem?.at("/expires_at")} w={150} />
        {workspaces.length > 1 && <NativeSelect size="xs" label={t("access.in")} value={workspace} onChange={(event) => setWorkspace(event.currentTarget.value)} data={[{ value: "", label: t("access.own") }, ...workspaces.map((row) => ({ value: row.id, label: row.name }))]} error={problem?.at("/workspace")} />}
        <Button type="submit" disabled={name === "" || scopes.length === 0} loading={create.isPending}>
          {t("access.make")}
        </Button>
      </Group>
      <ProblemAlert error={create.error} shown={["/name", "/scopes", "/expires_at", "/workspace"]} />
    </form>
  );
}
