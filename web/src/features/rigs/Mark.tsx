import { Badge } from "@mantine/core";
import type { Finding } from "./api";

const LOOK = { ok: ["green", "✓"], note: ["blue", "i"], fails: ["red", "✕"] } as const;

/** How something was found: a sign and a colour, and words for who sees neither. */
export function Mark({ result, text, label }: { result: Finding["result"] | undefined; text?: string; label?: string }) {
  const [color, sign] = result ? LOOK[result] : (["gray", "–"] as const);
  return (
    <Badge variant="outline" color={color} tt="none" miw={28} style={{ flexShrink: 0 }} {...(label ? { role: "img", "aria-label": label } : {})}>
      {text ? `${sign} ${text}` : sign}
    </Badge>
  );
}
