import { Alert, Button, List, type MantineSpacing } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { Problem } from "@/shared/api/problem";

interface Props {
  error: unknown;
  /** For the field that all of it belongs to: a file, of which no part is on the page. */
  id?: string;
  /** Places that a form shows beside its fields: what is wrong there is not repeated here. */
  shown?: readonly string[];
  onRetry?: () => void;
  m?: MantineSpacing;
}

/** What went wrong, in the words of the service. */
export function ProblemAlert({ error, id, shown = [], onRetry, m }: Props) {
  const { t } = useTranslation();
  if (!error) return null;
  const sentences = error instanceof Problem ? error.elsewhere(shown) : [error instanceof Error ? error.message : String(error)];
  if (sentences.length === 0) return null;
  return (
    <Alert color="red" variant="outline" title={t("problem.title")} m={m} role="alert">
      {/* The alert itself is named by its title: whatever refers to it would be told that alone. */}
      <div id={id}>
        {sentences.length === 1 ? (
          sentences[0]
        ) : (
          <List size="sm">
            {sentences.map((sentence) => (
              <List.Item key={sentence}>{sentence}</List.Item>
            ))}
          </List>
        )}
      </div>
      {onRetry && (
        <Button mt="xs" variant="default" onClick={onRetry}>
          {t("problem.again")}
        </Button>
      )}
    </Alert>
  );
}
