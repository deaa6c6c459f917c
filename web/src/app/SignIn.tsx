import { Button, Center, Paper, PasswordInput, Stack, Text, Title } from "@mantine/core";
import { useState } from "react";
import { useTranslation } from "react-i18next";
import { useSigning } from "./session";
import { Preferences } from "./Preferences";

export function SignIn() {
  const { t } = useTranslation();
  const { signIn } = useSigning();
  const [key, setKey] = useState("");
  const [wrong, setWrong] = useState<string>();
  const [busy, setBusy] = useState(false);

  const submit = async () => {
    setBusy(true);
    try {
      await signIn(key);
    } catch (error) {
      setWrong(error instanceof Error ? error.message : String(error));
      setBusy(false);
    }
  };
  return (
    <Center mih="100vh" component="main" p="md">
      <Paper withBorder p="xl" w={420} maw="100%">
        <form
          onSubmit={(event) => {
            event.preventDefault();
            void submit();
          }}
        >
          <Stack gap="md">
            <div>
              <Title order={1}>Servotune</Title>
              <Text c="dimmed" fz="sm">
                {t("signIn.purpose")}
              </Text>
            </div>
            <PasswordInput label={t("signIn.key")} description={t("signIn.where")} value={key} onChange={(event) => setKey(event.currentTarget.value)} error={wrong} aria-invalid={wrong !== undefined} autoFocus autoComplete="current-password" data-testid="key" visibilityToggleButtonProps={{ "aria-label": t("signIn.show"), "aria-hidden": false, tabIndex: 0 }} />
            <Button type="submit" loading={busy} disabled={key.trim() === ""} size="sm">
              {t("signIn.enter")}
            </Button>
            <Preferences />
          </Stack>
        </form>
      </Paper>
    </Center>
  );
}
