import { Group, Loader, Text } from "@mantine/core";
import classes from "./Busy.module.css";

/** Says what is being done; what is done at once never shows it. */
export function Busy({ children, corner = false }: { children: string; /** In the corner of what it stands in, where it moves nothing. */ corner?: boolean }) {
  return (
    <Group gap="xs" wrap="nowrap" role="status" className={classes.busy} data-corner={corner || undefined}>
      <Loader size="xs" aria-hidden />
      <Text span fz="xs">
        {children}
      </Text>
    </Group>
  );
}
