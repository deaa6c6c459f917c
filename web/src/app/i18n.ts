import i18n from "i18next";
import { initReactI18next } from "react-i18next";
import { english } from "@/locales/english";

export const LANGUAGES = { en: "English", ro: "Română" } as const;
export type Language = keyof typeof LANGUAGES;
const KEY = "servotune-language";

function wanted(): Language {
  const stored = localStorage.getItem(KEY) ?? navigator.language.slice(0, 2);
  return stored in LANGUAGES ? (stored as Language) : "en";
}

/** English comes with the page, others when they are asked for. */
async function load(language: Language): Promise<void> {
  if (language === "ro" && !i18n.hasResourceBundle("ro", "translation")) {
    const { romanian } = await import("@/locales/romanian");
    i18n.addResourceBundle("ro", "translation", romanian);
  }
}

export async function startLanguage(): Promise<void> {
  await i18n.use(initReactI18next).init({ lng: "en", fallbackLng: "en", resources: { en: { translation: english } }, interpolation: { escapeValue: false } });
  await changeLanguage(wanted());
}

export async function changeLanguage(language: Language): Promise<void> {
  await load(language);
  await i18n.changeLanguage(language);
  document.documentElement.lang = language;
  localStorage.setItem(KEY, language);
}
