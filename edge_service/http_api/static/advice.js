// What changed, and what to do: the headline, the tasks and the trend of the service in words.

import { sentenceOf } from "./dom.js";
import { clock, day, lasting, number, serverMs, significant } from "./format.js";
import { headlineOf } from "./level.js";
import { statementWords } from "./sentence.js";
import { has, language, named, t } from "./strings.js";

const NEAR_S = 172800;

const codeOf = (reason) => reason.split(":")[0];

// What the service says stays as it is in English; else its code is translated.
export function reasonWords(reason) {
  const key = `reason.${codeOf(reason)}`;
  return language !== "en" && has(key) ? { text: t(key) } : { text: sentenceOf(reason), lang: "en" };
}

export function reasonsOf(reading) {
  const reasons = (reading?.reasons ?? []).map(reasonWords);
  return reasons.length === 0 && has(`status.${reading?.status}`) ? [{ text: t(`status.${reading.status}`) }] : reasons;
}

// What the service says stays as it is in English; else its code is translated.
const wordsOr = (key, text) => (language !== "en" && has(key) ? { text: t(key) } : { text, lang: "en" });

export function headlineWords(state) {
  const headline = headlineOf(state);
  if (!headline) return { text: t("todo.wait") };
  return statementWords(headline);
}

export function whatToDo({ health, connected }) {
  if (!connected) return [{ text: t("todo.no_connection") }];
  if (!health) return [{ text: t("todo.wait") }];
  return health.advice.length ? health.advice.map(taskWords) : [{ text: t("todo.nothing") }];
}

function taskWords({ task, text, due, together_with: together }) {
  const words = wordsOr(`task.${task}`, text);
  const more = [...(due ? [isPast(due.earliest) ? t("task.due.now") : t("task.due", { first: moment(due.earliest) })] : []), ...together.map((each) => named("together", each))];
  return { ...words, text: [words.text, ...more].join(" ") };
}

// When a limit will be reached, and the end of the key that says so.
export function crossing(trend, limit) {
  const found = trend?.crossings.find((each) => each.limit === limit);
  if (!found?.earliest) return null;
  const [first, last] = [moment(found.earliest), found.latest && moment(found.latest)];
  return { first, last, form: isPast(found.earliest) ? (last ? ".by" : ".any") : last ? "" : ".after" };
}

const isPast = (time) => Date.parse(time) <= serverMs();

function moment(time) {
  const seconds = Math.max(0, (Date.parse(time) - serverMs()) / 1000);
  return t("moment", { time: seconds < NEAR_S ? clock(time) : day(time), span: lasting(seconds) });
}

export function whatChanged(state) {
  const { health, events, condition } = state;
  const sentences = [];
  const fall = health?.fall;
  if (fall) sentences.push(t("changed.fall", { time: clock(fall.time), from: number(fall.from_percent), to: number(fall.to_percent) }));
  const since = condition === "NORMAL" ? null : notNormalSince(events);
  if (since) sentences.push(t("changed.not_normal", { time: clock(since) }));
  sentences.push(trendSentence(health?.trend, condition !== "FAULT"));
  const part = events.findLast((event) => event.kind === "part_replaced");
  if (part) sentences.push(t("changed.part", { time: clock(part.at) }));
  return sentences.join(" ");
}

function notNormalSince(events) {
  const changes = events.filter((event) => event.kind === "condition_changed");
  const last = changes.findLastIndex((event) => event.data.to === "NORMAL");
  return changes[last + 1]?.at ?? null;
}

export function trendSentence(trend, hasLimitAhead) {
  if (!trend || trend.status === "too_early") return t("trend.too_early");
  const since = clock(trend.since);
  if (trend.status === "steady") return t("trend.steady");
  if (trend.status === "fell") return t("trend.fell", { part: significant(-trend.change_fresh_percent, 3), since, until: clock(trend.until) });
  const parts = [t(`trend.${trend.status}`, { since, level: significant(100 * trend.level), ...readableRate(trend) })];
  for (const limit of ["warning", "fault"]) {
    const when = crossing(trend, limit);
    if (when) parts.push(t(`trend.${limit}${when.form}`, when));
  }
  if (trend.status === "falling" && !trend.crossings.length && hasLimitAhead) parts.push(t("trend.undated"));
  return parts.join(" ");
}

function readableRate(trend) {
  const { value, low, high } = trend.rate_fresh_percent_per_h;
  const size = Math.abs(value);
  const [hours, unit] = size >= 1 ? [1 / 60, "minute"] : size * 24 >= 0.05 ? [24, "day"] : [24 * 365.25, "year"];
  const shown = (rate) => significant(hours * rate, 2);
  return { rate: shown(size), least: shown(Math.min(Math.abs(low), Math.abs(high))), most: shown(Math.max(Math.abs(low), Math.abs(high))), per: t(`per.${unit}`) };
}
