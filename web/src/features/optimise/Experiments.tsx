import { Button, Group, NativeSelect, Paper, Stack, Text, TextInput, Title } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { NumberEntry } from "@/shared/ui/NumberEntry";
import { changed, without, type Part } from "./form";
import { Drop } from "./parts";
import { SignalFields } from "./SignalFields";
import type { Experiment } from "./schema";

/** The commands under which goals over time are looked at. */
export function Experiments({ form, opened, signals, change, faultAt }: Part) {
  const { t } = useTranslation();
  const put = (i: number, part: Partial<Experiment>) => change({ experiments: changed(form.experiments, i, part) });
  const add = () => {
    const taken = new Set(form.experiments.map(({ name }) => name));
    const port = opened.inputs.find((input) => !form.experiments.some(({ commands }) => commands.some((command) => command.port === input))) ?? opened.inputs[0] ?? "";
    const plain = [port, "step"].find((name) => name !== "" && !taken.has(name));
    let number = 2;
    while (taken.has(`step ${number}`)) number++;
    change({ experiments: [...form.experiments, { name: plain ?? `step ${number}`, commands: [{ port, signal: { kind: "step", amplitude: 1 } }] }] });
  };
  /** Goals follow a new name. */
  const rename = (i: number, name: string) => change({ experiments: changed(form.experiments, i, { name }), goals: form.goals.map((goal) => (goal.experiment !== "" && goal.experiment === form.experiments[i]!.name ? { ...goal, experiment: name } : goal)) });
  const drop = (i: number) => change({ experiments: without(form.experiments, i), goals: form.goals.map((goal) => (goal.experiment === form.experiments[i]!.name ? { ...goal, experiment: "" } : goal)) });
  return (
    <section data-testid="experiments">
      <Title order={2}>{t("optimise.experiments")}</Title>
      <Text fz="sm" c="dimmed" mb="xs">
        {t("optimise.experimentsDoc")}
      </Text>
      <Stack gap="xs">
        {form.experiments.map((experiment, i) => (
          <Paper key={i} withBorder p="xs" maw={980}>
            <Group align="flex-start" gap="sm" wrap="nowrap" justify="space-between">
              <Stack gap="xs">
                {experiment.commands.map((command, k) => {
                  const at = `experiments.${i}.commands.${k}`;
                  const set = (part: Partial<typeof command>) => put(i, { commands: changed(experiment.commands, k, part) });
                  return (
                    <Group key={k} align="flex-start" gap="sm">
                      {k === 0 && <TextInput size="xs" label={t("optimise.experiment")} aria-label={t("optimise.experimentName", { number: i + 1 })} value={experiment.name} error={faultAt(`experiments.${i}.name`)} onChange={(event) => rename(i, event.currentTarget.value)} w={120} />}
                      <NativeSelect size="xs" label={t("optimise.input")} value={command.port} data={opened.inputs} error={faultAt(`${at}.port`)} onChange={(event) => set({ port: event.currentTarget.value })} />
                      <SignalFields signal={command.signal} signals={signals} at={`${at}.signal`} faultAt={faultAt} onChange={(signal) => set({ signal })} />
                      {k === 0 && <NumberEntry label={t("optimise.duration")} aria-label={t("optimise.durationOf", { name: experiment.name })} value={experiment.duration} unit="s" optional placeholder={t("optimise.auto")} error={faultAt(`experiments.${i}.duration`)} onCommit={(duration) => put(i, { duration })} w={110} />}
                      {k > 0 && <Drop label={t("optimise.dropCommand", { number: k + 1, name: experiment.name })} onClick={() => put(i, { commands: without(experiment.commands, k) })} />}
                    </Group>
                  );
                })}
                {opened.inputs.length > experiment.commands.length && (
                  <Group>
                    <Button variant="subtle" size="compact-xs" onClick={() => put(i, { commands: [...experiment.commands, { port: opened.inputs.find((input) => !experiment.commands.some(({ port }) => port === input)) ?? "", signal: { kind: "step", amplitude: 1 } }] })}>
                      {t("optimise.addCommand")}
                    </Button>
                  </Group>
                )}
              </Stack>
              {form.experiments.length > 1 && <Drop label={t("optimise.dropExperiment", { name: experiment.name })} onClick={() => drop(i)} />}
            </Group>
          </Paper>
        ))}
      </Stack>
      <Button variant="default" mt="xs" onClick={add}>
        {t("optimise.addExperiment")}
      </Button>
    </section>
  );
}
