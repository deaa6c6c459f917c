import { Paper, Stack, Text, Title } from "@mantine/core";
import type { ReactNode } from "react";

/** Nothing is here yet: what it would be, and how to get the first one. */
export function Empty({ title, children, action }: { title: string; children: ReactNode; action?: ReactNode }) {
  return (
    <Paper withBorder p="xl" data-testid="empty">
      <Stack align="flex-start" gap="sm" maw={620}>
        <Title order={2}>{title}</Title>
        <Text fz="sm">{children}</Text>
        {action}
      </Stack>
    </Paper>
  );
}
