import forms from "./en.forms.json";
import laboratory from "./en.laboratory.json";
import search from "./en.search.json";
import general from "./en.json";

/** Every text in English: it comes with the first load, since it stands in where a translation is missing. */
export const english = { ...general, ...laboratory, ...search, ...forms };
