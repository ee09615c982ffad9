// How grave an axis is: the level of the one headline that the service gives it.

import { t } from "./strings.js";

export const ORDER = ["FAULT", "WARNING", "UNAVAILABLE", "NORMAL"];

export const headlineOf = (state) => (state.connected ? state.health?.headline : null) ?? null;
export const levelOf = (state) => headlineOf(state)?.level ?? "UNAVAILABLE";
// Without a connection, or before the first answer, nothing is claimed.
export const isHeard = (state) => state.connected && state.health !== null;
// A service that has just started knows no alarms yet.
export const knowsAlarms = (state) => isHeard(state) && !state.health.reasons.some((each) => /^(no|stale)_health:/.test(each));
export const levelWords = (state) => (isHeard(state) ? t(`condition.${levelOf(state)}`) : t(state.connected ? "connection.waiting" : "connection.lost"));
export const openAlarms = (state) => (state.connected ? state.health?.alarms : null) ?? [];
export const isActive = (state, kind) => openAlarms(state).some((alarm) => alarm.alarm === kind && alarm.active);

// As the service sorts: by level, date of the next limit, and preload unless that is NORMAL.
const byUrgency = (a, b) => ORDER.indexOf(levelOf(a)) - ORDER.indexOf(levelOf(b)) || limitMs(a) - limitMs(b) || percentOf(a) - percentOf(b);
const limitMs = ({ health }) => Date.parse(health?.next_limit?.likely ?? health?.next_limit?.earliest ?? "9999-12-31");
const percentOf = (state) => (levelOf(state) === "NORMAL" ? 0 : (state.health?.of_fresh?.value ?? 1e9));
export const worstFirst = (states) => [...states].sort(byUrgency);

// Alarms that every axis has, for they are the service's: as text that tells them apart.
export function alarmsOfAll(states) {
  const [first, ...others] = states.map((state) => openAlarms(state).filter(({ alarm }) => alarm === "service").map(({ text }) => text));
  return new Set(first.filter((text) => others.every((each) => each.includes(text))));
}
