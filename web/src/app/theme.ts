import { createTheme, type CSSVariablesResolver, type MantineColorsTuple } from "@mantine/core";

/** Blue of the Okabe-Ito palette, in ten shades; white text on shade 7 and 8 has a contrast above 5. */
const servo: MantineColorsTuple = ["#e6f4fc", "#cfe6f5", "#9fcbe9", "#6cafdd", "#4598d3", "#2d89cd", "#1a7fc6", "#0b6aaa", "#0b5c8f", "#084a75"];

export const theme = createTheme({
  primaryColor: "servo",
  primaryShade: { light: 8, dark: 7 },
  autoContrast: true,
  colors: { servo },
  fontFamily: "system-ui, -apple-system, 'Segoe UI', Roboto, sans-serif",
  fontFamilyMonospace: "ui-monospace, 'SFMono-Regular', Menlo, Consolas, monospace",
  fontSizes: { xs: "0.75rem", sm: "0.8125rem", md: "0.875rem", lg: "1rem", xl: "1.125rem" },
  defaultRadius: "sm",
  cursorType: "pointer",
  headings: { fontWeight: "600", sizes: { h1: { fontSize: "1.375rem" }, h2: { fontSize: "1.0625rem" }, h3: { fontSize: "0.9375rem" } } },
  components: {
    Button: { defaultProps: { size: "xs" } },
    TextInput: { defaultProps: { size: "xs" } },
    // What explains a field stands below it: fields beside each other, with such a text and without, begin on one line.
    InputWrapper: { defaultProps: { inputWrapperOrder: ["label", "input", "description", "error"] } },
    NativeSelect: { defaultProps: { size: "xs" } },
    Select: { defaultProps: { size: "xs", allowDeselect: false } },
    MultiSelect: { defaultProps: { size: "xs" } },
    Textarea: { defaultProps: { size: "xs" } },
    // A menu holds items alone: an empty one that only catches the first focus is no child of it (ARIA), and a reader would read it.
    Menu: { defaultProps: { withInitialFocusPlaceholder: false } },
    Table: { defaultProps: { verticalSpacing: 6, fz: "sm" } },
  },
});

/** Mantine's dimmed text has too little contrast for small print (WCAG AA asks for 4.5). */
export const variables: CSSVariablesResolver = () => ({
  variables: {},
  light: { "--track": "#d5dade", "--mantine-color-dimmed": "#545b62", "--mantine-color-error": "#b3261e", "--mantine-color-anchor": "#0b5c8f", "--mantine-color-placeholder": "#6a7178", "--grid": "#e4e7ea", "--ink": "#24292e", "--panel": "#f6f8fa", "--line": "#545b62", "--warn": "#b84a00", "--plus": "#cfe6f5", "--minus": "#fbdcc6", "--minus-stripe": "#f8cfb1" },
  dark: { "--track": "#3f454b", "--mantine-color-dimmed": "#b4bac0", "--mantine-color-error": "#ff8f87", "--mantine-color-anchor": "#7fc1ec", "--mantine-color-placeholder": "#9aa1a8", "--grid": "#3a3f45", "--ink": "#d6dade", "--panel": "#1f2225", "--line": "#a4abb2", "--warn": "#ff9d5c", "--plus": "#1d4763", "--minus": "#5c3416", "--minus-stripe": "#6b3d1b" },
});
