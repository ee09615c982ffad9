// Sentences of the service in the reader's language, from their code and values.

import { significant } from "./format.js";
import { has, language, t } from "./strings.js";

const DIGITS = 6; // more than any value is sent with

// What the service says stands as it is in English, and wherever the page does not know the sentence.
export function sentenceWords(sentence, message) {
  const key = `said.${sentence?.code}`;
  if (language === "en" || !has(key)) return { text: message, lang: "en" };
  return { text: t(key, Object.fromEntries(Object.entries(sentence.values).map(([name, value]) => [name, shown(name, value)]))) };
}

// A value is a number, a code that the page has a word for, or a name.
function shown(name, value) {
  if (typeof value === "number") return significant(value, DIGITS);
  return has(`${name}.${value}`) ? t(`${name}.${value}`) : value;
}

export function alarmWords({ sentence, message, active }) {
  const { text, lang } = sentenceWords(sentence, message);
  return lang || active ? { text, lang } : { text: t("said.over", { said: text }) };
}

// The English message ends with the note of a person; other words are followed by it.
export function eventWords({ sentence, data }, message) {
  const { text, lang } = sentenceWords(sentence, message);
  return lang || !data.note ? { text, lang } : { text: `${text}: ${data.note}` };
}
