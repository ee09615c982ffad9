// The answer: is it all right, since when, how sure, what changed, what to do.

import { headlineWords, reasonsOf, whatChanged, whatToDo } from "./advice.js";
import { byId, element, list, refill, svg, symbol, write } from "./dom.js";
import { clock, lasting, number, printed } from "./format.js";
import { headlineOf, isHeard, levelOf, levelWords } from "./level.js";
import { t } from "./strings.js";

let parts = null;

function build(root) {
  const part = (name, tag, className, ...children) => [name, element(tag, { class: className }, ...children)];
  parts = Object.fromEntries([
    part("verdict", "h2", "verdict"),
    part("headline", "ul", "headline"),
    part("since", "p", "quiet"),
    part("value", "span", "number"),
    part("unit", "span", "unit"),
    part("sure", "p", "sure"),
    part("share", "p", "quiet"),
    part("reasons", "ul", "reasons"),
    part("changed", "p", ""),
    part("todo", "ol", "todo"),
    part("facts", "dl", "facts"),
  ]);
  parts.verdict.id = "answer-title";
  parts.gauge = svg("svg", { class: "gauge", viewBox: "0 0 420 40", role: "img" });
  root.replaceChildren(
    parts.verdict,
    parts.headline,
    parts.since,
    element("div", { class: "reading" }, element("p", { class: "value" }, parts.value, parts.unit), element("div", {}, parts.sure, parts.share)),
    parts.gauge,
    parts.reasons,
    element("h3", {}, t("answer.changed")),
    parts.changed,
    element("h3", {}, t("answer.todo")),
    parts.todo,
    parts.facts,
  );
}

export function renderAnswer(state, nowMs) {
  const root = byId("answer");
  if (parts === null) build(root);
  const { axis, health } = state;
  const level = levelOf(state);
  const reading = state.connected ? state.preload : null;
  const percent = reading?.preload_percent ?? null;
  root.dataset.level = level;
  refill(parts.verdict, `${axis}${level}${levelWords(state)}`, () => [symbol(level), element("span", { class: "badge" }, levelWords(state)), element("span", {}, t("answer.axis", { axis }))]);
  list(parts.headline, [headlineWords(state)].filter(() => state.connected));
  write(parts.since, sinceText(state));
  renderReading(state.limits, reading, health);
  list(parts.reasons, state.connected ? reasonsOf(reading) : [{ text: t("no_connection") }]);
  write(parts.changed, state.connected ? whatChanged(state) : t("answer.changed.unknown"));
  list(parts.todo, whatToDo(state));
  renderFacts(state, reading, nowMs);
  renderGauge(state.limits, reading, percent);
}

// Since when what the headline rests on holds: the alarm, or else the condition.
function sinceText(state) {
  const headline = headlineOf(state);
  if (!headline) return "";
  const { alarms, since } = state.health;
  const time = alarms.find(({ code, active }) => active && code === headline.code)?.raised_at ?? since;
  return t("answer.since", { time: clock(time), span: lasting((state.serverMs() - Date.parse(time)) / 1000) });
}

// Percent of the fresh screw, as in the headline; of the load rating where that is not known.
function renderReading(limits, reading, health) {
  const percent = reading?.preload_percent ?? null;
  const { value, low, high } = health?.of_fresh ?? reading?.of_fresh ?? { value: percent, low: reading?.low, high: reading?.high };
  const digits = limits ? 0 : 2;
  const isSure = percent !== null && low !== null && high !== null;
  const shown = isSure ? printed({ value, low, high }, digits) : null;
  write(parts.value, percent === null ? t("no_value") : (shown?.value ?? number(value, digits)));
  parts.value.classList.toggle("none", percent === null);
  parts.unit.hidden = percent === null;
  write(parts.unit, t(limits ? "unit.fresh" : "unit.rating"));
  write(parts.sure, percent === null ? "" : isSure ? t("answer.sure", { level: number(100 * reading.level), bounds: shown.bounds }) : t("answer.unsure"));
  write(parts.share, !limits ? t("answer.no_limits") : percent === null ? t("answer.fresh", { fresh: number(limits.fresh_percent, 2) }) : t("answer.rating", { n: number(percent, 2), fresh: number(limits.fresh_percent, 2) }));
}

function renderFacts(state, reading, nowMs) {
  const drag = reading?.drag_torque_nm ?? null;
  const facts = [
    [t("fact.condition"), isHeard(state) ? t(`condition.${state.condition}`) : "–"],
    [t("fact.measured"), ageText(state, nowMs)],
    [t("fact.drag"), drag ? t("fact.drag.value", printed(drag, 3)) : "–"],
    [t("fact.force"), reading?.preload_n == null ? "–" : t("unit.n", { n: number(reading.preload_n) })],
  ];
  refill(parts.facts, JSON.stringify(facts), () => facts.map(([name, text]) => element("div", {}, element("dt", {}, name), element("dd", {}, text))));
}

function ageText(state, nowMs) {
  if (state.preload?.age_s == null) return t("age.never");
  const age = state.preload.age_s + (nowMs - state.receivedMs) / 1000;
  return age < 1 ? t("age.now") : t("age.ago", { span: lasting(age) });
}

function renderGauge(limits, reading, percent) {
  const { gauge } = parts;
  gauge.setAttribute("aria-label", percent === null || !limits ? t("no_value") : t("of_fresh", { n: number(reading.of_fresh.value) }));
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
    ...ticks(limits.fault_percent, t("gauge.fault")),
    ...ticks(limits.warning_percent, t("gauge.warning")),
    ...ticks(limits.fresh_percent, t("gauge.fresh")),
  ];
  if (percent !== null) {
    const low = x(reading.low ?? percent);
    marks.push(svg("rect", { x: low, width: Math.max(x(reading.high ?? percent) - low, 2), y: 5, height: 16, rx: 3, class: "spread" }));
    marks.push(svg("rect", { x: x(percent) - 2, width: 4, y: 1, height: 24, rx: 2, class: "needle" }));
  }
  return gauge.replaceChildren(...marks);
}
