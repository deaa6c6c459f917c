import { Stack } from "@mantine/core";
import { useQuery } from "@tanstack/react-query";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { isProblem } from "@/shared/api/problem";
import { Empty } from "@/shared/ui/Empty";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { keysQuery, workspacesQuery, type NewKey } from "./api";
import { KeyForm } from "./KeyForm";
import { KeyShown } from "./KeyShown";
import { KeyTable } from "./KeyTable";
import { Workspaces } from "./Workspaces";

/** Keys of the workspace, what it may use and uses, and for those who run the installation all its workspaces. */
export function AccessPage() {
  const { t } = useTranslation();
  const keys = useQuery(keysQuery);
  const workspaces = useQuery(workspacesQuery);
  const [made, setMade] = useState<NewKey | null>(null);
  const closed = isProblem(keys.error, 403) ? keys.error : null;
  return (
    <div className="page">
      <PageHead title={t("nav.access")} doc={t("access.doc")} />
      <Stack gap="lg" display={keys.isPending || workspaces.isPending ? "none" : undefined}>
        {closed ? (
          <Empty title={t("access.closed")}>{closed.message}</Empty>
        ) : (
          <>
            <ProblemAlert error={keys.error} onRetry={() => void keys.refetch()} />
            <KeyForm workspaces={workspaces.data ?? []} onMade={setMade} />
            {made && <KeyShown made={made} />}
            <KeyTable keys={keys.data ?? []} onMade={setMade} />
          </>
        )}
        <ProblemAlert error={workspaces.error} onRetry={() => void workspaces.refetch()} />
        {workspaces.data && <Workspaces workspaces={workspaces.data} />}
      </Stack>
    </div>
  );
}
