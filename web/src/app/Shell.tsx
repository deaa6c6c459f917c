import { AppShell, Burger, Button, Group, Menu, Text } from "@mantine/core";
import { useDisclosure } from "@mantine/hooks";
import { Suspense } from "react";
import { useTranslation } from "react-i18next";
import { Link, Outlet, ScrollRestoration, useLocation } from "react-router";
import { FinderButton } from "./finder/FinderButton";
import { Preferences } from "./Preferences";
import { useSigning, useVisitor } from "./session";
import { TourCard } from "./TourCard";
import classes from "./Shell.module.css";

const PLACES = ["systems", "datasets", "jobs", "schedules", "rigs", "access", "about"] as const;
/** Pages below no place of their own, and the place they belong to. */
const BELONGS: Record<string, (typeof PLACES)[number]> = { acquisitions: "rigs", compare: "systems", identify: "datasets", lineage: "datasets", validate: "datasets" };

export function Shell() {
  const { t } = useTranslation();
  const [opened, { toggle, close }] = useDisclosure();
  const visitor = useVisitor().data;
  const { signOut } = useSigning();
  const { pathname } = useLocation();
  const first = pathname.split("/")[1] ?? "";
  const here = BELONGS[first] ?? first;
  const links = PLACES.map((place) => (
    <Link key={place} to={`/${place}`} className={classes.link!} onClick={close} aria-current={place === here ? (pathname === `/${place}` ? "page" : "true") : undefined}>
      {t(`nav.${place}`)}
    </Link>
  ));
  return (
    <AppShell header={{ height: 48 }} navbar={{ width: 220, breakpoint: "md", collapsed: { mobile: !opened, desktop: true } }}>
      <AppShell.Header className={classes.header}>
        <a href="#content" className="skip">
          {t("shell.skip")}
        </a>
        <Group h="100%" px="md" justify="space-between" wrap="nowrap">
          <Group gap="lg" wrap="nowrap">
            <Burger opened={opened} onClick={toggle} hiddenFrom="md" size="sm" aria-label={t("shell.menu")} />
            <Group gap={8} wrap="nowrap">
              <img src="/favicon.svg" width="22" height="22" alt="" />
              <Text fw={700}>Servotune</Text>
            </Group>
            <Group component="nav" gap={2} wrap="nowrap" visibleFrom="md" aria-label={t("shell.places")}>
              {links}
            </Group>
          </Group>
          <Group gap="xs" wrap="nowrap">
            <FinderButton />
            <Group visibleFrom="lg">
              <Preferences />
            </Group>
            <Menu position="bottom-end">
              <Menu.Target>
                <Button variant="default">{visitor?.name || t("shell.you")}</Button>
              </Menu.Target>
              <Menu.Dropdown>
                <Menu.Label>{visitor?.workspace}</Menu.Label>
                <Menu.Item onClick={() => void signOut()}>{t("shell.signOut")}</Menu.Item>
              </Menu.Dropdown>
            </Menu>
          </Group>
        </Group>
      </AppShell.Header>
      {/* Closed it is not there: out of sight, the tabulator key would still come to it. */}
      {opened && (
        <AppShell.Navbar p="sm" hiddenFrom="md">
          {links}
          <Preferences />
        </AppShell.Navbar>
      )}
      <AppShell.Main id="content" tabIndex={-1}>
        <Suspense>
          <Outlet />
        </Suspense>
      </AppShell.Main>
      <TourCard />
      <ScrollRestoration />
    </AppShell>
  );
}
