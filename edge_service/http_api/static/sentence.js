// Statements of the service in the reader's language, from their code and values.

import { clock, significant } from "./format.js";
import { has, t } from "./strings.js";

const DIGITS = 6; // more than any value is sent with

// What the service says stands as it is where the page does not know the sentence: in English, where no time is told.
export function statementWords({ code, text, values }) {
  const key = `said.${code}`;
  if (!has(key)) return { text, lang: "en" };
  const words = t(key, Object.fromEntries(Object.entries(values).map(([name, value]) => [name, shown(name, value)])));
  return { text: "value" in values || !words.includes("{value}") ? words : `${words.split(":")[0]}.` };
}

// A value is a number, a time, a code that the page has a word for, or a name.
function shown(name, value) {
  if (typeof value === "number") return significant(value, DIGITS);
  if (["time", "since", "until"].includes(name)) return clock(value);
  return has(`${name}.${value}`) ? t(`${name}.${value}`) : value;
}

// The English text ends with the note of a person; other words are followed by it.
export function eventWords(event) {
  const said = statementWords(event);
  return said.lang || !event.data.note ? said : { text: `${said.text}: ${event.data.note}` };
}
