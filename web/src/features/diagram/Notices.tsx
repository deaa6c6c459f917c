import { Alert, Button, Group, Text } from "@mantine/core";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { When } from "@/shared/ui/When";
import { Faults } from "./Faults";
import type { Check } from "./useCheck";
import type { useSaving } from "./useSaving";

interface Props {
  /** When what is shown was edited and not saved, in an earlier visit. */
  draftOf: string | null;
  check: Check;
  saving: ReturnType<typeof useSaving>;
  /** What an edit did besides. */
  notice: string | null;
  onRead(): void;
  onGo(scope: readonly string[], name: string): void;
}

/** What one has to know before going on: a draft, somebody else's edit, a service that is away, faults. */
export function Notices({ draftOf, check, saving, notice, onRead, onGo }: Props) {
  const { t } = useTranslation();
  const [told, setTold] = useState(draftOf !== null);
  return (
    <>
      {told && draftOf && (
        <Alert color="blue" variant="outline" m={6} p="xs" role="status" withCloseButton onClose={() => setTold(false)} closeButtonLabel={t("diagram.fineSo")}>
          <Group gap="xs">
            <Text span fz="sm">
              {t("diagram.draft")} <When at={draftOf} />
            </Text>
            <Button
              variant="default"
              onClick={() => {
                saving.discard();
                setTold(false);
              }}
            >
              {t("diagram.dropDraft")}
            </Button>
          </Group>
        </Alert>
      )}
      {saving.waiting && (
        <Alert color="orange" variant="outline" m={6} p="xs" role="status" data-testid="waiting">
          {t("diagram.waiting")}
        </Alert>
      )}
      {saving.overtaken && !saving.conflict && (
        <Alert color="orange" variant="outline" m={6} p="xs" role="status" data-testid="overtaken">
          <Group gap="xs">
            <Text span fz="sm">
              {t("diagram.overtaken")}
            </Text>
            <Button variant="default" onClick={() => (saving.dirty ? saving.compare() : saving.discard())}>
              {saving.dirty ? t("diagram.compare") : t("diagram.reload")}
            </Button>
          </Group>
        </Alert>
      )}
      {notice && (
        <Alert color="blue" variant="outline" m={6} p="xs" role="status" withCloseButton onClose={onRead} closeButtonLabel={t("diagram.fineSo")}>
          {notice}
        </Alert>
      )}
      {check.problem && <Faults problem={check.problem} onGo={onGo} />}
      {saving.failure !== null && <ProblemAlert error={saving.failure} m={6} />}
    </>
  );
}
