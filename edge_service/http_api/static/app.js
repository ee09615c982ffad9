// The live page: one stream in, one axis at a time out.

import { renderAnswer } from "./answer.js";
import { renderAlarms, renderDiary } from "./diary.js";
import { byId, clock, element, fetchJson, refill, symbol, words, write } from "./dom.js";
import { buildAudit } from "./audit.js";
import { renderHistory } from "./history.js";
import { loadTests } from "./jobs.js";
import { loadOutputs } from "./outputs.js";
import { renderService } from "./service.js";
import { addressOf, route } from "./route.js";
import { isSignedOut, signIn } from "./session.js";
import { translateDocument } from "./strings.js";
import { renderTabs } from "./tabs.js";
import { renderTraces, startTraces, takeLive } from "./traces.js";
import { loadUse } from "./use.js";
import { loadWhy, renderWhy } from "./why.js";

const SILENT_AFTER_MS = 4000; // the service sends every value once a second
const RENDER_MS = 250;
const SLOW_MS = 10000;
const RECONNECT_MS = 3000;
const KEPT_EVENTS = 1000;
const ORDER = ["FAULT", "WARNING", "UNAVAILABLE", "NORMAL"];

const states = new Map();
let shown = null;
let service = null;
let source = null;
let lastMessageMs = null;
let lastEventId = 0;
let clockOffsetMs = 0; // server time minus performance.now()
let connected = null;
let slowMs = -Infinity;

const serverMs = () => performance.now() + clockOffsetMs;

class AxisState {
  constructor({ axis, limits }, historyPlace) {
    Object.assign(this, { axis, limits, historyPlace, preload: null, health: null, events: [], connected: true, receivedMs: 0, serverMs });
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
  source = new EventSource(`/api/v1/events?last_event_id=${lastEventId}`);
  on("service", takeService);
  on("preload", (answer) => Object.assign(states.get(answer.axis) ?? {}, { preload: answer, receivedMs: performance.now() }));
  on("health", takeHealth);
  on("live", takeLive);
  on("event", (answer, message) => takeEvent(answer, Number(message.lastEventId)));
  on("lost", (answer) => takeEvent({ severity: "warning", axis: "", kind: "lost", message: `events are missing here: ${answer.reason}`, time: new Date(serverMs()).toISOString(), data: {} }, lastEventId + 0.5));
}

async function start() {
  try {
    await signIn();
    const { axes, history, site, machine } = await fetchJson("/api/v1/axes");
    write(byId("machine"), site ? `${site} / ${machine}` : "");
    setServerTime((await fetchJson("/api/v1/health")).time);
    for (const each of axes) {
      const state = new AxisState(each, history);
      const { events } = await fetchJson(`/api/v1/axes/${each.axis}/log`);
      state.events = events.slice(-KEPT_EVENTS);
      lastEventId = Math.max(lastEventId, events.at(-1)?.id ?? 0);
      states.set(each.axis, state);
    }
    show();
    connect();
  } catch {
    states.clear();
    setTimeout(start, RECONNECT_MS);
  }
}

async function reconnect() {
  source = null;
  if (!(await isSignedOut())) return connect();
  shown = null;
  states.clear();
  return start();
}

function show() {
  const before = shown;
  shown = states.get(route().axis) ?? worst();
  slowMs = -Infinity;
  if (shown !== before) startTraces(shown);
}

function worst() {
  return [...states.values()].sort((a, b) => ORDER.indexOf(a.condition) - ORDER.indexOf(b.condition))[0];
}

function setServerTime(time) {
  clockOffsetMs = Date.parse(time) - performance.now();
}

function takeService(answer) {
  setServerTime(answer.time);
  service = answer;
}

function takeHealth(answer) {
  const state = states.get(answer.axis);
  if (state === undefined) return;
  const before = state.health?.condition;
  state.health = answer;
  if (before !== undefined && before !== answer.condition) {
    const reason = answer.reasons.length ? `. ${words(answer.reasons[0])}` : "";
    byId("announcer").textContent = `Axis ${answer.axis}: ${answer.condition}${reason}`;
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
  if (!alive && source?.readyState === EventSource.CLOSED && nowMs - (lastMessageMs ?? 0) > RECONNECT_MS) reconnect();
  if (alive === connected || (connected === null && !alive && nowMs < SILENT_AFTER_MS)) return;
  const back = alive && connected === false;
  connected = alive;
  for (const state of states.values()) state.connected = alive;
  document.body.classList.toggle("old", !alive);
  const banner = byId("banner");
  banner.hidden = alive;
  banner.textContent = alive ? "" : `No connection to the service since ${clock(new Date())}. Everything on this page is old; trying again.`;
  byId("connection").dataset.state = alive ? "live" : "lost";
  write(byId("connection-text"), alive ? "live" : "connection lost");
  if (back && shown) {
    slowMs = -Infinity;
    startTraces(shown);
  }
}

function renderAxes() {
  const key = JSON.stringify([...states.values()].map((state) => [state.axis, state.condition, state === shown]));
  refill(byId("axes"), key, () => [...states.values()].map(chip));
  const first = worst();
  document.title = first.condition === "NORMAL" ? "All axes normal" : `${first.condition}: ${first.axis}`;
}

function chip(state) {
  const link = element("a", { href: addressOf(state.axis), class: "chip", "data-condition": state.condition }, symbol(state.condition), element("span", {}, element("b", {}, state.axis), ` ${state.condition}`));
  if (state === shown) link.setAttribute("aria-current", "true");
  return link;
}

function render() {
  const nowMs = performance.now();
  watchConnection(nowMs);
  if (!shown) return;
  renderAxes();
  const { tab } = route();
  renderTabs(shown.axis, tab);
  TAB_PARTS[tab].render(nowMs);
  if (!connected) return;
  TAB_PARTS[tab].live?.(nowMs);
  if (nowMs - slowMs < SLOW_MS) return;
  slowMs = nowMs;
  TAB_PARTS[tab].load?.().catch(() => {});
}

// What each tab draws at once, while there is a connection, and every few seconds from new answers.
const TAB_PARTS = {
  overview: { render: (nowMs) => [renderAnswer(shown, nowMs), renderAlarms(shown), renderTraces(shown)] },
  why: { render: () => renderWhy(shown), load: () => loadWhy(shown) },
  history: { render: () => renderDiary(shown), live: (nowMs) => renderHistory(shown, nowMs), load: () => loadUse(shown) },
  tests: { render: () => {}, load: () => loadTests(shown) },
  service: { render: () => [renderService(shown, service), buildAudit()], load: () => loadOutputs(service) },
};

addEventListener("hashchange", show);
document.querySelector(".skip").addEventListener("click", (event) => {
  event.preventDefault();
  document.querySelector("main:not([hidden])").focus();
});
translateDocument();
start();
setInterval(render, RENDER_MS);
