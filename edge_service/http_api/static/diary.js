// Alarms and diary: what happened, who took note, and what was done about it.

import { button, byId, clock, element, fetchJson, refill, write } from "./dom.js";
import { ifMay, may, signedName } from "./session.js";

const COMMAND = ["POST", "/api/v1/axes/{axis}/commands"];
const SHOWN = 60;
const NAMES = { preload_low: "Preload low", preload_lost: "Preload lost", rate: "Wears fast", sudden_drop: "Sudden drop", model: "Model does not fit", data_lost: "Data lost", service: "Service part down" };
let pending = null;

export function renderAlarms(state) {
  const root = byId("alarms");
  const alarms = state.health?.alarms ?? [];
  refill(root, JSON.stringify([state.axis, alarms, state.connected]), () => [
    element("h2", { id: "alarms-title" }, alarms.length ? `Alarms (${alarms.length})` : "Alarms"),
    ...(alarms.length ? [...alarms.map((alarm) => alarmNode(state, alarm)), ifMay(COMMAND, "To acknowledge or shelve", () => "")] : [element("p", { class: "quiet" }, "No alarm is active, and none waits for anybody.")]),
  ]);
}

function alarmNode(state, alarm) {
  const about = `${alarm.active ? "active since" : "was active, raised"} ${clock(alarm.raised_at)}${alarm.cleared_at ? `, over ${clock(alarm.cleared_at)}` : ""}`;
  const seen = alarm.acknowledged_by ? `acknowledged by ${alarm.acknowledged_by}${alarm.note ? `: ${alarm.note}` : ""}` : "not acknowledged";
  const shelf = alarm.shelved_until ? `; shelved until ${clock(alarm.shelved_until)}` : "";
  const buttons = element("div", { class: "buttons" });
  const name = NAMES[alarm.alarm];
  const act = (action, title, text, more = {}) => button(title, { "aria-label": `${title}: ${name}` }, () => ask(state.axis, { action, alarm: alarm.alarm, ...more }, `${title}: ${name}`, text));
  if (!alarm.acknowledged_by) buttons.append(act("acknowledge", "Acknowledge", "Says that you have taken note."));
  if (alarm.shelved_until) buttons.append(act("unshelve", "End shelving", "It calls people again."));
  else buttons.append(act("shelve", "Shelve 8 h", "For 8 hours it calls nobody; the condition is shown all the same.", { duration_s: 28800 }));
  return element("div", { class: `alarm ${alarm.severity}`, "data-active": alarm.active }, element("p", {}, element("b", {}, `${alarm.active ? "▲" : "△"} ${name}`), ` – ${alarm.message}`), element("p", { class: "quiet" }, `${about}; ${seen}${shelf}`), may(COMMAND) ? buttons : "");
}

export function renderDiary(state) {
  const root = byId("diary");
  if (!root.firstChild) {
    root.replaceChildren(
      element("div", { class: "panel-head" }, element("h2", { id: "diary-title" }, "Diary"), ifMay(COMMAND, "To write notes", noteButtons)),
      element("ol", { class: "events", tabindex: "0", "aria-labelledby": "diary-title" }),
    );
  }
  pending = state;
  const events = state.events.slice(-SHOWN).reverse();
  refill(root.querySelector("ol"), `${state.axis}${events.length}${events[0]?.id}`, () => (events.length ? events.map(eventNode) : [element("li", { class: "quiet" }, "Nothing has happened yet.")]));
}

function noteButtons() {
  return element("div", { class: "buttons" },
    button("Write a note", {}, () => ask(pending.axis, { action: "note" }, "Write a note", "It is drawn in the history.")),
    button("Part replaced", {}, () => ask(pending.axis, { action: "part_replaced" }, "Part replaced", "The trend and the use of the part begin anew. This cannot be undone.")));
}

function eventNode(event) {
  return element(
    "li",
    { class: `event ${event.severity}` },
    element("time", { datetime: event.time, title: event.time }, clock(event.time)),
    element("span", { class: "event-axis" }, event.axis || "service"),
    element("span", { class: "event-severity" }, event.severity),
    element("span", { class: "event-text" }, event.message),
  );
}

function ask(axis, command, title, text) {
  write(byId("ask-title"), title);
  write(byId("ask-text"), text);
  write(byId("ask-ok"), title.split(":")[0]);
  write(byId("ask-error"), "");
  byId("ask-user").value = signedName() ?? localStorage.getItem("user") ?? "";
  byId("ask-user").readOnly = signedName() !== null;
  byId("ask-note").value = "";
  const key = crypto.randomUUID(); // pressed again after a lost answer, it is done once
  byId("ask-form").onsubmit = (event) => {
    event.preventDefault();
    send(axis, key, { ...command, user: byId("ask-user").value.trim(), note: byId("ask-note").value.trim() });
  };
  byId("ask-cancel").onclick = () => byId("ask").close();
  byId("ask").showModal();
}

async function send(axis, key, command) {
  try {
    localStorage.setItem("user", command.user);
    await fetchJson(`/api/v1/axes/${axis}/commands`, { method: "POST", headers: { "content-type": "application/json", "idempotency-key": `"${key}"` }, body: JSON.stringify(command) });
    byId("ask").close();
  } catch (error) {
    write(byId("ask-error"), `It was not taken: ${error.message}`);
  }
}

