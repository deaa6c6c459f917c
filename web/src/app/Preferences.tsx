import { Group, NativeSelect, useMantineColorScheme, type MantineColorScheme } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { changeLanguage, LANGUAGES, type Language } from "./i18n";

export function Preferences() {
  const { t, i18n } = useTranslation();
  const { colorScheme, setColorScheme } = useMantineColorScheme();
  return (
    <Group gap="xs" wrap="nowrap">
      <NativeSelect size="xs" aria-label={t("shell.language")} value={i18n.language} onChange={(event) => void changeLanguage(event.currentTarget.value as Language)} data={Object.entries(LANGUAGES).map(([value, label]) => ({ value, label }))} />
      <NativeSelect
        size="xs"
        aria-label={t("shell.theme")}
        value={colorScheme}
        onChange={(event) => setColorScheme(event.currentTarget.value as MantineColorScheme)}
        data={(["auto", "light", "dark"] as const).map((value) => ({ value, label: t(`shell.${value}`) }))}
      />
    </Group>
  );
}
