// Alarms that call for somebody, and how to answer them; one of the whole service stands once.

import { ask } from "./ask.js";
import { button, element, refill } from "./dom.js";
import { clock } from "./format.js";
import { ORDER, knowsAlarms, openAlarms } from "./level.js";
import { statementWords } from "./sentence.js";
import { locale, named, t } from "./strings.js";

const SHELVED_S = 8 * 3600;

// All alarms of these axes, gravest first; the axis is named where there may be several.
export function renderAlarmList(root, states, several) {
  const alarms = together(states.flatMap((state) => openAlarms(state).map((alarm) => ({ ...alarm, axis: state.axis }))));
  alarms.sort((a, b) => Number(b.active) - Number(a.active) || ORDER.indexOf(a.level) - ORDER.indexOf(b.level));
  const place = ({ axes }) => (!several ? "" : axes.length > 1 && axes.length === states.length ? t("alarms.all_axes") : new Intl.ListFormat(locale).format(axes));
  const isKnown = states.every(knowsAlarms);
  refill(root, JSON.stringify([alarms, several, isKnown]), () => [
    element("h2", { id: `${root.id}-title` }, alarms.length ? t("alarms.some", { n: alarms.length }) : t("alarms")),
    ...(alarms.length ? [...alarms.map((alarm) => alarmNode(alarm, place(alarm)))] : [element("p", { class: "quiet" }, t(isKnown ? "alarms.none" : "alarms.unknown"))]),
  ]);
}

// A part of the service that several axes rest on raises an alarm at each of them.
function together(alarms) {
  const found = new Map();
  for (const alarm of alarms) {
    const key = JSON.stringify(alarm.alarm === "service" ? [alarm.text, alarm.active, alarm.acknowledged_by, Boolean(alarm.shelved_until)] : [alarm.axis, alarm.alarm]);
    if (!found.has(key)) found.set(key, { ...alarm, axes: [], occurrences: {} });
    found.get(key).axes.push(alarm.axis);
    found.get(key).occurrences[alarm.axis] = alarm.occurrence;
  }
  return [...found.values()];
}

function alarmNode(alarm, place) {
  const name = named("alarm", alarm.alarm);
  const { text, lang } = statementWords(alarm);
  const said = alarm.active ? [" – ", element("span", lang ? { lang } : {}, text)] : []; // one that is over says so below
  const title = element("p", {}, element("b", {}, `${alarm.active ? "▲" : "△"} ${place ? `${place}: ` : ""}${name}`), ...said);
  return element("div", { class: `alarm ${alarm.level}`, "data-active": alarm.active }, title, element("p", { class: "quiet" }, ...aboutParts(alarm)), buttonsNode(alarm, place ? `${place} ${name}` : name));
}

function aboutParts(alarm) {
  const parts = [t(alarm.active ? "alarm.active" : "alarm.over", { since: clock(alarm.raised_at), until: clock(alarm.cleared_at ?? alarm.raised_at) }), "; "];
  if (!alarm.acknowledged_by) parts.push(t("alarm.not_seen"));
  else parts.push(t("alarm.seen"), " ", element("span", { lang: "en" }, `${alarm.acknowledged_by}${alarm.note ? `: ${alarm.note}` : ""}`));
  if (alarm.shelved_until) parts.push("; ", t("alarm.shelved", { until: clock(alarm.shelved_until) }));
  return parts;
}

function buttonsNode(alarm, about) {
  const act = (action, more = {}) => {
    const title = `${t(`alarm.${action}`)}: ${about}`;
    return button(t(`alarm.${action}`), { "aria-label": title }, () => ask(alarm.axes, { action, alarm: alarm.alarm, ...more }, title, t(`alarm.${action}.text`)));
  };
  const shelf = alarm.shelved_until ? act("unshelve") : act("shelve", { duration_s: SHELVED_S });
  return element("div", { class: "buttons" }, ...(alarm.acknowledged_by ? [] : [act("acknowledge", { occurrences: alarm.occurrences })]), shelf);
}
