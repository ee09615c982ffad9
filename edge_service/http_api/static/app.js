// The live page: one stream in, the machine or one of its axes out.

import { headlineWords } from "./advice.js";
import { renderAlarmList } from "./alarms.js";
import { renderAnswer } from "./answer.js";
import { findSignedName } from "./ask.js";
import { renderDiary } from "./diary.js";
import { byId, element, fetchJson, refill, symbol, write } from "./dom.js";
import { loadDrift } from "./drift.js";
import { clock, serverMs, setServerTime } from "./format.js";
import { renderHistory } from "./history.js";
import { isHeard, levelOf, levelWords, worstFirst } from "./level.js";
import { loadLog } from "./log.js";
import { renderMachine } from "./machine.js";
import { loadOutputs } from "./outputs.js";
import { PAGES, addressOf, route } from "./route.js";
import { renderService } from "./service.js";
import { loadSetup } from "./setup.js";
import { t, translateDocument } from "./strings.js";
import { hideTabs, renderTabs } from "./tabs.js";
import { loadTests, renderTests } from "./tests.js";
import { renderTraces, startTraces, takeLive } from "./traces.js";
import { loadUse } from "./use.js";
import { loadWhy, renderWhy } from "./why.js";

const SILENT_AFTER_MS = 4000; // the service sends every value once a second
const RENDER_MS = 250;
const SLOW_MS = 10000;
const RECONNECT_MS = 3000;
const KEPT_EVENTS = 1000;
// Panels that wait for answers: emptied when another axis is shown, so that none says what is not its own.
const OF_AXIS = ["belief", "friction", "model", "quality", "past", "use", "drift"];

const states = new Map();
let shown = null; // the axis; null while the machine or another page is shown
let service = null;
let source = null;
let lastMessageMs = null;
let lastEventId = 0;
let connected = null;
let slowMs = -Infinity;
let triedMs = 0; // when a stream was last asked for


class AxisState {
  constructor({ axis, limits }) {
    Object.assign(this, { axis, limits, preload: null, health: null, events: [], connected: true, receivedMs: 0, serverMs });
  }

  get condition() {
    return this.connected ? (this.health?.condition ?? "UNAVAILABLE") : "UNAVAILABLE";
  }
}

function on(name, handle) {
  source.addEventListener(name, (message) => {
    lastMessageMs = performance.now();
    handle(JSON.parse(message.data), message);
  });
}

function connect() {
  source?.close();
  triedMs = performance.now();
  source = new EventSource(`/api/v1/events?last_event_id=${lastEventId}`);
  on("service", takeService);
  on("preload", (answer) => Object.assign(states.get(answer.axis) ?? {}, { preload: answer, receivedMs: performance.now() }));
  on("health", takeHealth);
  on("live", takeLive);
  on("event", (answer, message) => takeEvent(answer, Number(message.lastEventId)));
  on("lost", (answer) => takeEvent({ level: "WARNING", axis: "", kind: "lost", code: "", values: {}, text: `${t("events.lost")} ${answer.reason}`, at: new Date(serverMs()).toISOString(), data: {} }, lastEventId + 0.5));
}

// Place in the usual order of a machine's axes; others come after them.
const rank = (axis) => ("XYZABCUVW".indexOf(axis[0].toUpperCase()) + 10) % 10;

async function start() {
  try {
    await findSignedName();
    const { axes, site, machine } = await fetchJson("/api/v1/axes");
    axes.sort((one, other) => rank(one.axis) - rank(other.axis) || one.axis.localeCompare(other.axis));
    write(byId("place"), site ? `${site} / ${machine}` : "");
    setServerTime((await fetchJson("/api/v1/health")).time);
    const logs = await Promise.all(axes.map(({ axis }) => fetchJson(`/api/v1/log?axis=${encodeURIComponent(axis)}&limit=${KEPT_EVENTS}`)));
    axes.forEach((each, i) => {
      const state = new AxisState(each);
      const events = logs[i].items.reverse();
      state.events = events;
      lastEventId = Math.max(lastEventId, events.at(-1)?.id ?? 0);
      states.set(each.axis, state);
    });
    if (axes.length === 0 && !route().page) location.hash = "#/setup";
    show();
    connect();
  } catch {
    states.clear();
    setTimeout(start, RECONNECT_MS);
  }
}

function show() {
  const before = shown;
  const { page, axis } = route();
  const only = states.size === 1 ? [...states.values()][0] : null;
  shown = page ? null : (states.get(axis) ?? only);
  slowMs = -Infinity;
  byId("machine").hidden = page !== null || shown !== null;
  for (const id of PAGES) byId(id).hidden = id !== page;
  for (const link of byId("pages").children) {
    if (link.getAttribute("href") === (page ? `#/${page}` : shown && shown !== only ? null : "#/")) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  if (shown === null) hideTabs();
  else if (shown !== before) {
    for (const id of OF_AXIS) byId(id).replaceChildren();
    startTraces(shown);
  }
}

function takeService(answer) {
  setServerTime(answer.time);
  service = answer;
}

function takeHealth(answer) {
  const state = states.get(answer.axis);
  if (state === undefined) return;
  const before = state.health?.headline;
  state.health = answer;
  if (before && (before.level !== answer.headline.level || before.code !== answer.headline.code)) {
    byId("announcer").textContent = `${t("announced", { axis: answer.axis, level: levelWords(state) })} ${headlineWords(state).text}`;
  }
}

function takeEvent(event, id) {
  if (id <= lastEventId) return;
  lastEventId = Math.floor(id);
  for (const state of states.values()) {
    if (event.axis && event.axis !== state.axis) continue;
    state.events.push({ ...event, id });
    state.events.splice(0, state.events.length - KEPT_EVENTS);
  }
}

function watchConnection(nowMs) {
  const alive = lastMessageMs !== null && nowMs - lastMessageMs < SILENT_AFTER_MS;
  if (!alive && source?.readyState === EventSource.CLOSED && nowMs - triedMs > RECONNECT_MS) connect();
  if (alive === connected || (connected === null && !alive && nowMs < SILENT_AFTER_MS)) return;
  const back = alive && connected === false;
  connected = alive;
  for (const state of states.values()) state.connected = alive;
  document.body.classList.toggle("old", !alive);
  const banner = byId("banner");
  banner.hidden = alive;
  banner.textContent = alive ? "" : t("banner", { time: clock(new Date()) });
  byId("connection").dataset.state = alive ? "live" : "lost";
  write(byId("connection-text"), t(alive ? "connection.live" : "connection.lost"));
  if (back && shown) {
    slowMs = -Infinity;
    startTraces(shown);
  }
}

function renderAxes() {
  const all = [...states.values()];
  const isMachine = shown === null && !route().page;
  const key = JSON.stringify([isMachine, all.map((state) => [state.axis, levelWords(state), state === shown])]);
  refill(byId("axes"), key, () => (isMachine ? [] : all.map(chip)));
  const [first] = worstFirst(all);
  document.title = !isHeard(first) ? levelWords(first) : levelOf(first) === "NORMAL" ? t("title.NORMAL") : `${levelWords(first)}: ${first.axis}`;
}

function chip(state) {
  const link = element("a", { href: addressOf(state.axis), class: "chip", "data-level": levelOf(state) }, symbol(levelOf(state)), element("span", {}, element("b", {}, state.axis), ` ${levelWords(state)}`));
  if (state === shown) link.setAttribute("aria-current", "true");
  return link;
}

function render() {
  const nowMs = performance.now();
  watchConnection(nowMs);
  const { page, tab } = route();
  if (states.size > 0) renderAxes();
  if (!page && states.size === 0) return;
  if (!page && shown === null) return renderMachine([...states.values()], nowMs, connected);
  if (!page) renderTabs(shown.axis, tab);
  const part = PARTS[page ?? tab];
  part.render(nowMs);
  if (!connected) return;
  if (nowMs - slowMs < SLOW_MS) return;
  slowMs = nowMs;
  part.load?.().catch(() => {});
}

// What each tab and page draws at once, and, while there is a connection, every few seconds from new answers.
const PARTS = {
  overview: { render: (nowMs) => [renderAnswer(shown, nowMs), renderAlarmList(byId("alarms"), [shown], false), renderTraces(shown)] },
  why: { render: () => renderWhy(shown), load: () => loadWhy(shown) },
  history: { render: (nowMs) => [renderDiary(shown), renderHistory(shown, nowMs)], load: () => Promise.all([loadUse(shown), loadDrift(shown)]) },
  tests: { render: () => renderTests(shown), load: () => loadTests(shown) },
  service: { render: () => renderService(service), load: () => Promise.all([loadOutputs(service), loadLog()]) },
  setup: { render: () => {}, load: loadSetup },
};

addEventListener("hashchange", show);
document.querySelector(".skip").addEventListener("click", (event) => {
  event.preventDefault();
  document.querySelector("main:not([hidden])").focus();
});
translateDocument();
start();
setInterval(render, RENDER_MS);
