import { Button, Group, Progress, Text, Title } from "@mantine/core";
import { useMutation, useQueryClient } from "@tanstack/react-query";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { api, must } from "@/shared/api/client";
import { isProblem } from "@/shared/api/problem";
import { DataTable } from "@/shared/ui/DataTable";
import { PlainEntry } from "@/shared/ui/PlainEntry";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { formatNumber } from "@/shared/units/format";
import { COUNTED, workspaceQuery, type Counted, type Limits, type Workspace } from "./api";

const shown = (what: Counted, amount: number) => (what === "stored_bytes" ? `${formatNumber(amount / 1e9, 3)} GB` : String(amount));

/** What a workspace uses of what it may have; limits of its own are entered beside, empty ones are as everywhere. */
export function Quotas({ workspace, etag }: { workspace: Workspace; etag: string }) {
  const { t } = useTranslation();
  const queries = useQueryClient();
  const own: Limits = workspace.document.limits ?? {};
  const [limits, setLimits] = useState<Limits>(own);
  const changed = COUNTED.some((what) => (limits[what] ?? null) !== (own[what] ?? null));
  const save = useMutation({
    mutationFn: () => must(api.PUT("/v1/workspaces/{identifier}", { params: { path: { identifier: workspace.id }, header: { "If-Match": etag } }, body: { name: workspace.name, limits: Object.fromEntries(Object.entries(limits).filter(([, amount]) => amount != null)) } })),
    onSuccess: () => queries.invalidateQueries({ queryKey: workspaceQuery(workspace.id).queryKey }),
  });
  const problem = isProblem(save.error) ? save.error : null;
  return (
    <section aria-labelledby="quotas">
      <Title order={3} id="quotas" mt="md" mb="xs">
        {t("access.quotasOf", { name: workspace.name })}
      </Title>
      <DataTable
        testId="quotas"
        maxWidth={860}
        rows={COUNTED}
        keyOf={(what) => what}
        columns={[
          { title: t("access.what"), cell: (what) => t(`access.counted.${what}`) },
          { title: t("access.inUse"), numeric: true, cell: (what) => shown(what, workspace.used[what]) },
          { title: t("access.allowed"), numeric: true, cell: (what) => shown(what, workspace.limits[what]) },
          { title: t("access.share"), width: 160, cell: (what) => <Share used={workspace.used[what]} limit={workspace.limits[what]} label={t(`access.counted.${what}`)} /> },
          {
            title: t("access.ownLimit"),
            width: 190,
            cell: (what) => <PlainEntry aria-label={t("access.limitOf", { what: t(`access.counted.${what}`) })} value={limits[what] ?? undefined} optional placeholder={t("access.usual")} onCommit={(value) => setLimits({ ...limits, [what]: value ?? null })} error={problem?.at(`/limits/${what}`)} />,
          },
        ]}
      />
      <ProblemAlert error={save.error} shown={COUNTED.map((what) => `/limits/${what}`)} />
      <Group mt="xs">
        <Button variant="default" onClick={() => save.mutate()} disabled={!changed} loading={save.isPending}>
          {t("access.keepLimits")}
        </Button>
        <Text fz="xs" c="dimmed">
          {t("access.quotasDoc")}
        </Text>
      </Group>
    </section>
  );
}

function Share({ used, limit, label }: { used: number; limit: number; label: string }) {
  const part = limit > 0 ? used / limit : 1;
  return <Progress value={100 * Math.min(1, part)} color={part >= 0.9 ? "orange" : undefined} aria-label={label} />;
}
