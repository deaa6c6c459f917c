import { Alert, Button, Code, CopyButton, Group, Text } from "@mantine/core";
import { useTranslation } from "react-i18next";
import type { NewKey } from "./api";

/** A key that was just made: the service shows it once, and so does the page. */
export function KeyShown({ made }: { made: NewKey }) {
  const { t } = useTranslation();
  if (!made.key) return null;
  return (
    <Alert color="green" variant="outline" title={t("access.once")}>
      <Text fz="sm" mb="xs">
        {made.name}
      </Text>
      <Group>
        <Code data-testid="new-key">{made.key}</Code>
        <CopyButton value={made.key}>
          {({ copied, copy }) => (
            <Button variant="default" onClick={copy}>
              {copied ? t("optimise.copied") : t("access.copy")}
            </Button>
          )}
        </CopyButton>
      </Group>
    </Alert>
  );
}
