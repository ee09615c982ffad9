// Words of the page: by the browser's language, or the one that was chosen here.

import { de } from "./strings/de.js";
import { en } from "./strings/en.js";

const LANGUAGES = { en, de };
const wished = [localStorage.getItem("language"), ...navigator.languages.map((each) => each.slice(0, 2))];
export const language = wished.find((each) => each in LANGUAGES) ?? "en";
export const locale = navigator.languages.find((each) => each.startsWith(language)) ?? language;

export const has = (key) => key in LANGUAGES[language];

// Text of a key, with its {values} put in.
export function t(key, values = {}) {
  const text = LANGUAGES[language][key];
  if (text === undefined) throw new Error(`no words for ${key}`);
  return text.replace(/\{(\w+)\}/g, (_, name) => values[name]);
}

// Word for a code of the service; the code itself where the page has no word for it yet.
export const named = (kind, code) => (has(`${kind}.${code}`) ? t(`${kind}.${code}`) : code.replaceAll("_", " "));

// Text of the key that a number asks for: `key.one` or `key.other`.
export const counted = (key, n) => t(`${key}.${n === 1 ? "one" : "other"}`, { n: n.toLocaleString(locale) });

function choose(next) {
  localStorage.setItem("language", next);
  location.reload();
}

// The choice of the language, each by its own name.
function languageChoice() {
  const select = document.getElementById("language");
  for (const [code, words] of Object.entries(LANGUAGES)) {
    const option = Object.assign(document.createElement("option"), { value: code, textContent: words.language, lang: code });
    select.append(option);
  }
  select.value = language;
  select.addEventListener("change", () => choose(select.value));
}

// Fills the words of the document itself: data-t is its text, data-t-label its name.
export function translateDocument() {
  document.documentElement.lang = language;
  for (const node of document.querySelectorAll("[data-t]")) node.textContent = t(node.dataset.t);
  for (const node of document.querySelectorAll("[data-t-label]")) node.setAttribute("aria-label", t(node.dataset.tLabel));
  languageChoice();
}
