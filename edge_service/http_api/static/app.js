// The live page: one stream in, one card per axis out.

import { Card, componentTexts, symbol } from "./card.js";
import { element, list, words, write } from "./dom.js";
import { SPAN_S, STEP_S } from "./plot.js";

const SILENT_AFTER_MS = 4000; // the service sends every value once a second
const RENDER_MS = 250;
const RECONNECT_MS = 3000;
const SHOWN_EVENTS = 200;
const ORDER = ["FAULT", "WARNING", "UNAVAILABLE", "NORMAL"];

const byId = (id) => document.getElementById(id);
const cards = new Map();
let source = null;
let lastMessageMs = null;
let lastEventId = 0;
let clockOffsetMs = 0; // server time minus performance.now()
let connected = null;
let lostSince = null;

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
  on("preload", (answer) => cards.get(answer.axis)?.take(answer, performance.now()));
  on("health", takeHealth);
  on("event", (answer, message) => takeEvent(answer, Number(message.lastEventId)));
  on("lost", (answer) => addEvent({ severity: "warning", axis: "", message: `events are missing here: ${answer.reason}`, time: null }));
}

async function start() {
  try {
    const { axes } = await fetchJson("/api/v1/axes");
    byId("axes").replaceChildren();
    cards.clear();
    for (const { axis, limits } of axes) {
      const card = new Card(axis, limits);
      cards.set(axis, card);
      byId("axes").append(card.node);
    }
    const { time } = await fetchJson("/api/v1/health");
    setServerTime(time);
    await Promise.all([...cards.values()].map(loadHistory));
    connect();
  } catch {
    setTimeout(start, RECONNECT_MS);
  }
}

async function fetchJson(path) {
  const response = await fetch(path);
  if (!response.ok) throw new Error(`${path}: ${response.status}`);
  return response.json();
}

async function loadHistory(card) {
  const from = (serverMs() / 1000 - SPAN_S).toFixed(0);
  const aligned = from - (from % STEP_S);
  const { buckets } = await fetchJson(`/api/v1/axes/${card.axis}/history?from=${aligned}&step=${STEP_S}`);
  card.history.load(buckets);
}

function setServerTime(time) {
  clockOffsetMs = Date.parse(time) - performance.now();
}

function serverMs() {
  return performance.now() + clockOffsetMs;
}

function takeService(answer) {
  setServerTime(answer.time);
  const waiting = answer.reasons.map((reason) => reason.replace(/: [a-z_]+: /, ": "));
  write(byId("service-state"), answer.ready ? "Every axis has fresh input." : `Not ready – ${waiting.join("; ")}.`);
  list(byId("service-components"), componentTexts(answer.components));
}

function takeHealth(answer) {
  const card = cards.get(answer.axis);
  if (card === undefined) return;
  const before = card.health?.condition;
  card.health = answer;
  if (before !== undefined && before !== answer.condition) {
    const reason = answer.reasons.length ? `. ${words(answer.reasons[0])}` : "";
    byId("announcer").textContent = `Axis ${answer.axis}: ${answer.condition}${reason}`;
  }
}

function takeEvent(answer, id) {
  if (id <= lastEventId) return;
  lastEventId = id;
  addEvent(answer);
}

function addEvent(event) {
  const time = event.time === null ? "" : new Date(event.time).toLocaleTimeString([], { hour12: false });
  const item = element(
    "li",
    { class: `event ${event.severity}` },
    element("time", event.time === null ? {} : { datetime: event.time, title: event.time }, time),
    element("span", { class: "event-axis" }, event.axis || "service"),
    element("span", { class: "event-severity" }, event.severity),
    element("span", { class: "event-text" }, event.message),
  );
  const events = byId("events");
  events.prepend(item);
  while (events.children.length > SHOWN_EVENTS) events.lastElementChild.remove();
  byId("events-empty").hidden = true;
}

function watchConnection(nowMs) {
  const alive = lastMessageMs !== null && nowMs - lastMessageMs < SILENT_AFTER_MS;
  if (!alive && source?.readyState === EventSource.CLOSED && nowMs - (lastMessageMs ?? 0) > RECONNECT_MS) connect();
  if (alive === connected || (connected === null && !alive && nowMs < SILENT_AFTER_MS)) return;
  connected = alive;
  lostSince = alive ? null : new Date();
  for (const card of cards.values()) card.connected = alive;
  const banner = byId("banner");
  banner.hidden = alive;
  banner.textContent = alive ? "" : `No connection to the service since ${lostSince.toLocaleTimeString([], { hour12: false })}. Nothing on this page is current; trying again.`;
  byId("connection").dataset.state = alive ? "live" : "lost";
  write(byId("connection-text"), alive ? "live" : "connection lost");
}

function renderSummary() {
  if (cards.size === 0) return;
  const groups = ORDER.map((condition) => [condition, [...cards.values()].filter((card) => card.condition === condition)]);
  const key = JSON.stringify(groups.map(([condition, members]) => [condition, members.map((card) => card.axis)]));
  const summary = byId("summary");
  if (summary.dataset.key === key) return;
  summary.dataset.key = key;
  summary.replaceChildren(...groups.filter(([, members]) => members.length > 0).map(([condition, members]) => chip(condition, members)));
  const worst = groups.find(([, members]) => members.length > 0)[0];
  document.title = worst === "NORMAL" ? "All axes normal" : `${worst}: ${groups.find(([name]) => name === worst)[1].map((card) => card.axis).join(", ")}`;
}

function chip(condition, members) {
  const links = members.flatMap((card, i) => [i ? ", " : " ", element("a", { href: `#card-${card.axis}` }, card.axis)]);
  return element("span", { class: "chip", "data-condition": condition }, symbol(condition), element("span", {}, element("b", {}, condition), ...links));
}

function render() {
  const nowMs = performance.now();
  watchConnection(nowMs);
  renderSummary();
  for (const card of cards.values()) card.render(nowMs, serverMs() / 1000);
}

start();
setInterval(render, RENDER_MS);
