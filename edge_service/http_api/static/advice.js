// What changed, and what to do: sentences from the condition, the alarms and the trend.

import { sentenceOf } from "./dom.js";
import { clock, day, lasting, ofFresh, significant } from "./format.js";
import { has, language, t } from "./strings.js";

const CODES = ["process_force", "no_motion", "learning", "insufficient_excitation", "stale_input", "no_input", "no_data", "no_limit", "confirming", "no_number"];
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

export function whatToDo(state) {
  const { health, preload, connected } = state;
  if (!connected) return t("todo.no_connection");
  if (!health) return t("todo.wait");
  const isUnseen = health.alarms.some((alarm) => !alarm.acknowledged_by);
  const sentences = mainAdvice(state, health, preload);
  if (isUnseen) sentences.push(t("todo.acknowledge"));
  return sentences.length ? sentences.join(" ") : t("todo.nothing");
}

function mainAdvice({ condition }, health, preload) {
  const active = new Set(health.alarms.filter((alarm) => alarm.active).map((alarm) => alarm.alarm));
  const fault = crossing(health.trend, "fault");
  if (condition === "FAULT") return [...(active.has("sudden_drop") ? [t("todo.stop")] : []), t("todo.fault")];
  if (active.has("model") || preload?.status === "invalid") return [t("todo.model")];
  if (condition === "WARNING") return [fault ? t("todo.warning.by", fault) : t("todo.warning")];
  if (condition === "UNAVAILABLE") return [unavailable(health, preload)];
  if (active.has("rate")) return [fault ? t("todo.rate.by", fault) : t("todo.rate")];
  if (health.trend?.status === "rising") return [t("todo.rising")];
  return [];
}

function unavailable(health, preload) {
  const codes = [...health.reasons, ...(preload?.reasons ?? [])].map(codeOf);
  if (preload?.status === "insufficient_excitation") codes.push("insufficient_excitation");
  const code = CODES.find((each) => codes.includes(each));
  return t(code ? `todo.${code}` : "todo.unknown");
}

export function crossing(trend, limit) {
  const found = trend?.crossings.find((each) => each.limit === limit);
  if (!found?.earliest) return null;
  return { first: moment(found.earliest), last: found.latest ? moment(found.latest) : null };
}

function moment(time) {
  const seconds = Math.max(0, (Date.parse(time) - Date.now()) / 1000);
  return t("moment", { time: seconds < NEAR_S ? clock(time) : day(time), span: lasting(seconds) });
}

export function whatChanged(state) {
  const { health, events, condition, limits } = state;
  const sentences = [];
  const sudden = health?.alarms.find((alarm) => alarm.alarm === "sudden_drop");
  if (sudden) sentences.push(t("changed.sudden", { time: clock(sudden.raised_at) }));
  const since = condition === "NORMAL" ? null : notNormalSince(events);
  if (since) sentences.push(t("changed.not_normal", { time: clock(since) }));
  sentences.push(trendSentence(health?.trend, limits));
  const part = events.findLast((event) => event.kind === "part_replaced");
  if (part) sentences.push(t("changed.part", { time: clock(part.time) }));
  return sentences.join(" ");
}

function notNormalSince(events) {
  const changes = events.filter((event) => event.kind === "condition_changed");
  const last = changes.findLastIndex((event) => event.data.to === "NORMAL");
  return changes[last + 1]?.time ?? null;
}

export function trendSentence(trend, limits) {
  if (!trend || trend.status === "too_early") return t("trend.too_early");
  const since = clock(trend.since);
  if (trend.status === "steady") return t("trend.steady", { since });
  const parts = [t(`trend.${trend.status}.${limits ? "fresh" : "rating"}`, { since, level: significant(100 * trend.level), ...readableRate(trend, limits) })];
  for (const limit of ["warning", "fault"]) {
    const when = crossing(trend, limit);
    if (when) parts.push(t(when.last ? `trend.${limit}` : `trend.${limit}.after`, when));
  }
  return parts.join(" ");
}

function readableRate(trend, limits) {
  const { value, low, high } = trend.rate_percent_per_h;
  const size = Math.abs(value);
  const [hours, unit] = size >= 1 ? [1 / 60, "minute"] : size * 24 >= 0.05 ? [24, "day"] : [24 * 365.25, "year"];
  const shown = (rate) => significant(hours * (limits ? ofFresh(rate, limits) : rate), 2);
  return { rate: shown(size), least: shown(Math.min(Math.abs(low), Math.abs(high))), most: shown(Math.max(Math.abs(low), Math.abs(high))), per: t(`per.${unit}`) };
}
