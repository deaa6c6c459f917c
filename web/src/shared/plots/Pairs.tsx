import { SimpleGrid } from "@mantine/core";
import type { ComponentProps } from "react";
import classes from "./Pairs.module.css";

/** Plots, or what is as large, two by two where there is room for two; one that is left alone takes its row. */
export function Pairs(props: Omit<ComponentProps<typeof SimpleGrid>, "cols" | "spacing">) {
  return <SimpleGrid className={classes.pairs} cols={{ base: 1, md: 2 }} spacing="sm" {...props} />;
}
