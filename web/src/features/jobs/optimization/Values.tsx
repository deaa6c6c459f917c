import { Badge, Group } from "@mantine/core";
import { useTranslation } from "react-i18next";
import type { LiveParameter } from "@/shared/live/protocol";
import { withUnit } from "@/shared/units/format";
import type { Asked } from "./candidate";
import { endOf } from "./ends";

interface Props {
  values: Record<string, number>;
  parameters: ReadonlyMap<string, LiveParameter>;
  /** Their ranges, as they were asked for. */
  variables: Asked["variables"];
}

/** Values of the design variables; those at an end of their range are marked. */
export function Values({ values, parameters, variables = [] }: Props) {
  const { t } = useTranslation();
  return (
    <Group gap="xs" mb="sm" data-testid="values">
      {Object.entries(values).map(([path, value]) => {
        const known = parameters.get(path);
        const asked = variables.find(({ parameter }) => parameter === path);
        // What was not said is the document's; a bound in another unit is not compared.
        const bound = (key: "lower" | "upper") => (typeof asked?.[key] === "number" ? asked[key] : asked && asked[key] == null ? (known?.[key] ?? undefined) : undefined);
        const end = asked ? endOf(value, { lower: bound("lower"), upper: bound("upper") }) : null;
        return (
          <Badge key={path} variant="outline" color={end ? "orange" : "gray"} size="lg" tt="none" fw={500} c="var(--ink)" data-end={end ?? undefined}>
            {path} = {withUnit(value, known?.unit ?? "", 5)}
            {end && ` · ${t(`jobs.atEnd.${end}`)}`}
          </Badge>
        );
      })}
    </Group>
  );
}
