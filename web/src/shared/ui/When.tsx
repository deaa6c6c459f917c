import { useTranslation } from "react-i18next";

/** A moment, in the reader's language and time zone. */
export function When({ at, dateOnly = false }: { at: string | null | undefined; dateOnly?: boolean }) {
  const { i18n } = useTranslation();
  if (!at) return <>–</>;
  return (
    <time dateTime={at} className="numbers">
      {new Intl.DateTimeFormat(i18n.language, dateOnly ? { dateStyle: "medium", timeZone: "UTC" } : { dateStyle: "medium", timeStyle: "short" }).format(new Date(at))}
    </time>
  );
}
