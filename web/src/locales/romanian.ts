import forms from "./ro.forms.json";
import laboratory from "./ro.laboratory.json";
import general from "./ro.json";

export const romanian = { ...general, ...laboratory, ...forms };
