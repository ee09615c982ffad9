// The whole machine: one row per axis, worst first, and one list of alarms.

import { crossing } from "./advice.js";
import { renderAlarmList } from "./alarms.js";
import { byId, element, fetchJson, refill, svg, symbol } from "./dom.js";
import { lasting, ofFresh, printed } from "./format.js";
import { alarmsOfAll, headlineOf, isHeard, knowsAlarms, levelOf, levelWords, openAlarms, worstFirst } from "./level.js";
import { addressOf } from "./route.js";
import { locale, named, t } from "./strings.js";

const WEEK_S = 7 * 86400;
const STEP_S = 3 * 3600;
const LOAD_MS = 60000;
const TOP_PERCENT = 125; // of fresh, the end of a bar
const weeks = new Map(); // axis -> [[share of the week, percent of fresh]]
let loadedMs = -Infinity;

export function renderMachine(states, nowMs, connected) {
  if (connected && nowMs - loadedMs > LOAD_MS) {
    loadedMs = nowMs;
    for (const state of states) loadWeek(state).catch(() => {});
  }
  const sorted = worstFirst(states);
  const shared = alarmsOfAll(states);
  renderHeadline(sorted, shared.size > 0);
  const root = byId("axis-list");
  const rows = sorted.map((state) => rowText(state, shared));
  const focused = root.contains(document.activeElement) ? document.activeElement.getAttribute("href") : null;
  refill(root, JSON.stringify(rows), () => sorted.map((state, i) => element("li", {}, rowNode(state, rows[i]))));
  if (focused) root.querySelector(`a[href="${focused}"]`)?.focus();
  renderAlarmList(byId("machine-alarms"), sorted, true);
}

async function loadWeek(state) {
  const end = state.serverMs() / 1000;
  const { buckets } = await fetchJson(`/api/v1/axes/${encodeURIComponent(state.axis)}/history?from=${end - WEEK_S}&to=${end}&step=${STEP_S}`);
  const known = buckets.filter((bucket) => bucket.preload_percent && state.limits);
  weeks.set(state.axis, known.map((bucket) => [1 - (end - Date.parse(bucket.time) / 1000) / WEEK_S, ofFresh(bucket.preload_percent.mean, state.limits)]));
}

function renderHeadline(sorted, isServiceDown) {
  const level = levelOf(sorted[0]);
  const same = sorted.filter((state) => (level === "UNAVAILABLE" ? levelOf(state) === level : ["FAULT", "WARNING"].includes(levelOf(state))));
  const own = same.filter((state) => !isServiceDown || headlineOf(state)?.code !== "part_down");
  const axes = new Intl.ListFormat(locale).format(own.map((state) => (level === "UNAVAILABLE" ? state.axis : `${state.axis} (${levelWords(state)})`)));
  const key = level === "UNAVAILABLE" ? level : "attention";
  const counts = { n: own.length, all: sorted.length, axes };
  const text = !sorted.every(isHeard) ? t(sorted[0].connected ? "todo.wait" : "no_connection") : level === "NORMAL" ? t("machine.NORMAL", counts) : own.length === 0 ? t("machine.service") : t(`machine.${key}.${own.length === 1 ? "one" : "other"}`, counts);
  const root = byId("machine-answer");
  root.dataset.level = level;
  refill(root, text, () => [element("h2", { id: "machine-title", class: "verdict" }, symbol(level), element("span", {}, text))]);
}

function rowText(state, shared) {
  const { preload, health, connected, axis } = state;
  const share = connected && preload?.of_fresh ? (health?.of_fresh ?? preload.of_fresh) : null; // as in the headline
  const alarms = openAlarms(state).filter((alarm) => alarm.active && (alarm.alarm !== "service" || !shared.has(alarm.text)));
  return {
    axis,
    level: levelOf(state),
    words: levelWords(state),
    share: share ? { value: Math.round(share.value), low: Math.round(share.low), high: Math.round(share.high) } : null,
    shown: share ? printed(share) : null,
    limit: limitText(state),
    alarms: alarms.length ? alarms.map((alarm) => named("alarm", alarm.alarm)).join(", ") : !knowsAlarms(state) ? "" : t(shared.size ? "machine.alarms.own_none" : "machine.alarms.none"),
    hasAlarm: alarms.length > 0,
    week: weeks.get(axis) ?? [],
  };
}

// The limit that comes next, or the one that was passed.
function limitText({ health, condition, connected }) {
  if (!connected) return "";
  for (const limit of ["warning", "fault"]) {
    const when = crossing(health?.trend, limit);
    if (when) return t(`machine.limit.${limit}${when.form}`, when);
  }
  if (condition === "UNAVAILABLE") return "";
  if (health?.reasons.some((each) => each.startsWith("may_be_below"))) return t("machine.limit.maybe");
  return t(condition === "NORMAL" ? "machine.limit.none" : `machine.limit.passed.${condition}`);
}

function rowNode(state, row) {
  return element("a", { href: addressOf(row.axis), class: "axis-row", "data-level": row.level },
    element("span", { class: "axis-name" }, symbol(row.level), element("b", {}, row.axis), element("span", { class: "badge" }, row.words)),
    element("span", { class: "axis-value" }, row.shown ? t("of_fresh", { n: row.shown.value }) : t("no_value"), element("small", { class: "quiet" }, row.shown?.bounds ?? "")),
    barNode(row, state.limits),
    weekNode(row),
    element("span", { class: "axis-limit" }, row.limit),
    element("span", { class: "axis-alarms", "data-any": String(row.hasAlarm) }, row.alarms));
}

function barNode({ share }, limits) {
  const node = svg("svg", { class: "axis-bar", viewBox: "0 0 100 14", preserveAspectRatio: "none", "aria-hidden": "true" });
  if (!limits) return node;
  const x = (percent) => (100 * Math.min(Math.max(percent, 0), TOP_PERCENT)) / TOP_PERCENT;
  const zone = (name, from, to) => svg("rect", { x: x(from), width: x(to) - x(from), y: 4, height: 6, class: `zone ${name}` });
  const [fault, warning] = [ofFresh(limits.fault_percent, limits), ofFresh(limits.warning_percent, limits)];
  node.append(zone("fault", 0, fault), zone("warning", fault, warning), zone("normal", warning, TOP_PERCENT));
  if (!share) return node;
  const { value, low, high } = share;
  node.append(svg("rect", { x: x(low), width: Math.max(x(high) - x(low), 1), y: 2, height: 10, class: "spread" }), svg("rect", { x: x(value) - 0.5, width: 1, y: 0, height: 14, class: "needle" }));
  return node;
}

// The last seven days; a day without numbers is a hole.
function weekNode({ week }) {
  const node = svg("svg", { class: week.length > 1 ? "week" : "week empty", viewBox: "0 0 100 24", preserveAspectRatio: "none", role: "img", "aria-label": t("machine.week") });
  const y = (percent) => 24 - (24 * Math.min(percent, TOP_PERCENT)) / TOP_PERCENT;
  const points = week.map(([at, percent], i) => `${i && at - week[i - 1][0] < (2.5 * STEP_S) / WEEK_S ? "L" : "M"}${(100 * at).toFixed(1)} ${y(percent).toFixed(1)}h.6`);
  node.append(svg("path", { d: points.join("") || "M0 0", class: "week-line" }));
  return node;
}
