// The log of the service: events of all axes, notes and commands, newest first, page by page.

import { button, byId, element, fetchJson, refill } from "./dom.js";
import { eventNode } from "./diary.js";
import { t } from "./strings.js";

const FIRST = "/api/v1/log?limit=50";
const parts = {};
let older = []; // events of the pages that were asked for after the first
let next = null;

function build() {
  parts.list = element("ol", { class: "events", tabindex: "0", "aria-labelledby": "log-title" });
  parts.more = button(t("log.older"), { id: "log-older" }, more);
  byId("log").replaceChildren(element("h2", { id: "log-title" }, t("log")), parts.list, element("div", { class: "buttons" }, parts.more));
}

export async function loadLog() {
  if (!parts.list) build();
  const first = await fetchJson(FIRST);
  if (!older.length) next = first.next;
  const newest = first.items.at(-1)?.id ?? 0;
  const events = [...first.items, ...older.filter(({ id }) => id < newest)];
  parts.more.hidden = next === null;
  refill(parts.list, events.map(({ id }) => id).join(), () => (events.length ? events.map(eventNode) : [element("li", { class: "quiet" }, t("diary.empty"))]));
}

async function more() {
  const page = await fetchJson(next);
  older = [...older, ...page.items];
  next = page.next;
  await loadLog();
}
