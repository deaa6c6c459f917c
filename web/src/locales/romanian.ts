import forms from "./ro.forms.json";
import laboratory from "./ro.laboratory.json";
import search from "./ro.search.json";
import general from "./ro.json";

export const romanian = { ...general, ...laboratory, ...search, ...forms };
