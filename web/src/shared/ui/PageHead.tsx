import { Group, Text, Title } from "@mantine/core";
import { useDocumentTitle } from "@mantine/hooks";
import type { ReactNode } from "react";

export function PageHead({ title, doc, children }: { title: string; doc?: ReactNode; children?: ReactNode }) {
  useDocumentTitle(`${title} · Servotune`);
  return (
    <Group justify="space-between" align="flex-start" mb="md" gap="md">
      {/* Whether the buttons stand beside it or below does not depend on its text: a name that comes later would move the page. */}
      <div style={{ flex: "1 1 240px", minWidth: 0 }}>
        <Title order={1}>{title}</Title>
        {doc && (
          <Text c="dimmed" fz="sm" maw={760}>
            {doc}
          </Text>
        )}
      </div>
      <Group gap="xs">{children}</Group>
    </Group>
  );
}
