// The answer: is it all right, since when, how sure, what changed, what to do.

import { byId, clock, element, lasting, list, refill, svg, symbol, words, write } from "./dom.js";
import { whatChanged, whatToDo } from "./advice.js";

const TITLES = { NORMAL: "is all right", WARNING: "needs attention", FAULT: "is not all right", UNAVAILABLE: "cannot be judged" };
const STATUS_WORDS = {
  unestimated: "No estimate yet",
  insufficient_excitation: "Recent motion cannot tell the preload",
  invalid: "Model and data disagree: no number",
};
let parts = null;

function build(root) {
  const part = (name, tag, className, ...children) => [name, element(tag, { class: className }, ...children)];
  parts = Object.fromEntries([
    part("verdict", "h2", "verdict"),
    part("since", "p", "quiet"),
    part("value", "span", "number"),
    part("unit", "span", "unit", "%"),
    part("sure", "p", "sure"),
    part("share", "p", "quiet"),
    part("reasons", "ul", "reasons"),
    part("changed", "p", ""),
    part("todo", "p", "todo"),
    part("facts", "dl", "facts"),
  ]);
  parts.verdict.id = "answer-title";
  parts.gauge = svg("svg", { class: "gauge", viewBox: "0 0 420 40", role: "img" });
  root.replaceChildren(
    parts.verdict,
    parts.since,
    element("div", { class: "reading" }, element("p", { class: "value" }, parts.value, parts.unit), element("div", {}, parts.sure, parts.share)),
    parts.gauge,
    parts.reasons,
    element("h3", {}, "What changed"),
    parts.changed,
    element("h3", {}, "What to do"),
    parts.todo,
    parts.facts,
  );
}

export function renderAnswer(state, nowMs) {
  const root = byId("answer");
  if (parts === null) build(root);
  const { axis, condition, health } = state;
  const reading = state.connected ? state.preload : null;
  const percent = reading?.preload_percent ?? null;
  root.dataset.condition = condition;
  refill(parts.verdict, `${axis}${condition}`, () => [symbol(condition), element("span", { class: "badge" }, condition), element("span", {}, ` Axis ${axis} ${TITLES[condition]}`)]);
  write(parts.since, state.connected && health ? `since ${clock(health.since)} (${lasting((state.serverMs() - Date.parse(health.since)) / 1000)})` : "");
  write(parts.value, percent === null ? "no value" : percent.toFixed(2));
  parts.value.classList.toggle("none", percent === null);
  parts.unit.hidden = percent === null;
  write(parts.sure, sureText(reading, percent));
  write(parts.share, shareText(state.limits, percent));
  list(parts.reasons, reasonsOf(state, reading));
  write(parts.changed, state.connected ? whatChanged(state) : "Unknown while there is no connection.");
  write(parts.todo, whatToDo(state));
  renderFacts(state, reading, nowMs);
  renderGauge(state.limits, reading, percent);
}

function sureText(reading, percent) {
  if (percent === null) return "";
  if (reading.low === null || reading.high === null) return "its uncertainty is not known";
  return `${(100 * reading.level).toFixed(0)} % sure: ${reading.low.toFixed(2)} to ${reading.high.toFixed(2)} %`;
}

function shareText(limits, percent) {
  if (!limits) return "no limits: the fresh preload is not known";
  const fresh = limits.fresh_percent;
  return percent === null ? `fresh screw: ${fresh.toFixed(2)} %` : `${((100 * percent) / fresh).toFixed(0)} % of the fresh screw (${fresh.toFixed(2)} %)`;
}

function reasonsOf(state, reading) {
  if (!state.connected) return ["No connection to the service"];
  const reasons = (reading?.reasons ?? []).map(words);
  const status = STATUS_WORDS[reading?.status];
  return reasons.length === 0 && status ? [status] : reasons;
}

function renderFacts(state, reading, nowMs) {
  const drag = reading?.drag_torque_nm ?? null;
  const facts = [
    ["Measured", ageText(state, nowMs)],
    ["Drag torque", drag ? `${drag.value.toFixed(3)} N m (${drag.low.toFixed(3)} to ${drag.high.toFixed(3)})` : "–"],
    ["Preload force", reading?.preload_n == null ? "–" : `${reading.preload_n.toFixed(0)} N`],
  ];
  refill(parts.facts, JSON.stringify(facts), () => facts.map(([name, text]) => element("div", {}, element("dt", {}, name), element("dd", {}, text))));
}

function ageText(state, nowMs) {
  if (state.preload?.age_s == null) return "never";
  const age = state.preload.age_s + (nowMs - state.receivedMs) / 1000;
  return age < 1 ? "just now" : `${lasting(age)} ago`;
}

function renderGauge(limits, reading, percent) {
  const { gauge } = parts;
  gauge.setAttribute("aria-label", percent === null ? "no preload value" : `preload ${percent.toFixed(2)} percent`);
  gauge.classList.toggle("empty", !limits);
  if (!limits) return gauge.replaceChildren();
  const top = Math.max(limits.fresh_percent * 1.25, reading?.high ?? 0);
  const x = (value) => (Math.min(Math.max(value, 0), top) / top) * 420;
  const zone = (name, from, to) => svg("rect", { x: x(from), width: x(to) - x(from), y: 9, height: 8, class: `zone ${name}` });
  const ticks = (value, name) => [
    svg("line", { x1: x(value), x2: x(value), y1: 6, y2: 22, class: "fresh" }),
    svg("text", { x: x(value), y: 36, class: "tick" }, name),
  ];
  const marks = [
    zone("fault", 0, limits.fault_percent),
    zone("warning", limits.fault_percent, limits.warning_percent),
    zone("normal", limits.warning_percent, top),
    ...ticks(limits.fault_percent, "fault"),
    ...ticks(limits.warning_percent, "warning"),
    ...ticks(limits.fresh_percent, "fresh"),
  ];
  if (percent !== null) {
    const low = x(reading.low ?? percent);
    marks.push(svg("rect", { x: low, width: Math.max(x(reading.high ?? percent) - low, 2), y: 5, height: 16, rx: 3, class: "spread" }));
    marks.push(svg("rect", { x: x(percent) - 2, width: 4, y: 1, height: 24, rx: 2, class: "needle" }));
  }
  return gauge.replaceChildren(...marks);
}
