import { Text } from "@mantine/core";
import { useEffect, useState } from "react";
import { useTranslation } from "react-i18next";

/** Less than this is no ground for a forecast: a share of the work, seconds of it. */
const LEAST = 0.03;
const SECONDS = 2;

/** Seconds that are left where `share` took so many; null where that cannot be said yet. */
export function remaining(elapsed: number, share: number): number | null {
  return share < LEAST || share >= 1 || elapsed < SECONDS ? null : (elapsed * (1 - share)) / share;
}

/** `1:02:03`, `2:03`. */
export function clock(seconds: number): string {
  const whole = Math.max(0, Math.round(seconds));
  const [h, m, s] = [Math.floor(whole / 3600), Math.floor(whole / 60) % 60, whole % 60];
  const two = (value: number) => String(value).padStart(2, "0");
  return h > 0 ? `${h}:${two(m)}:${two(s)}` : `${m}:${two(s)}`;
}

/** Time elapsed and left while a job runs, told anew every second. */
export function JobClock({ since, share }: { since: string; share: number }) {
  const { t } = useTranslation();
  const [now, setNow] = useState(Date.now);
  useEffect(() => {
    const timer = setInterval(() => setNow(Date.now()), 1000);
    return () => clearInterval(timer);
  }, []);
  const elapsed = Math.max(0, (now - Date.parse(since)) / 1000);
  const left = remaining(elapsed, share);
  return (
    <Text fz="sm" className="numbers" role="timer" aria-live="off" data-testid="clock">
      {t("jobs.elapsed", { time: clock(elapsed) })}
      {left !== null && ` · ${t("jobs.left", { time: clock(left) })}`}
    </Text>
  );
}
