import { Alert, Anchor, List } from "@mantine/core";
import { useTranslation } from "react-i18next";
import type { Problem } from "@/shared/api/problem";

const MOST = 3;

/** What is wrong, each with the way to the block it belongs to. */
export function Faults({ problem, onGo }: { problem: Problem; onGo(scope: string[], name: string): void }) {
  const { t } = useTranslation();
  const faults = problem.document.errors ?? [];
  return (
    <Alert color="red" variant="outline" m={6} p="xs" role="alert">
      {faults.length === 0 && problem.message}
      <List size="sm" listStyleType="none">
        {faults.slice(0, MOST).map((fault) => {
          const path = [...fault.pointer.matchAll(/\/blocks\/([^/]+)/g)].map((match) => match[1]!);
          return (
            <List.Item key={fault.pointer + fault.detail}>
              {path.length > 0 && (
                <>
                  <Anchor component="button" className="numbers" onClick={() => onGo(path.slice(0, -1), path.at(-1)!)}>
                    {path.join(".")}
                  </Anchor>
                  {": "}
                </>
              )}
              {fault.detail}
            </List.Item>
          );
        })}
        {faults.length > MOST && <List.Item>{t("conflict.more", { count: faults.length - MOST })}</List.Item>}
      </List>
    </Alert>
  );
}
