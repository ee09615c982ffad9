// Audit log: who changed what, read when somebody opens it.

import { byId, clock, element, fetchJson } from "./dom.js";
import { ifMay } from "./session.js";

const SHOWN = 200;
const BEGUN = "begun";

const AUDIT = ["GET", "/api/v1/audit"];

export function buildAudit() {
  if (!byId("audit").firstChild) byId("audit").append(ifMay(AUDIT, "To read who changed what", auditNode));
}

function auditNode() {
  const entries = element("ol", { class: "events", tabindex: "0", "aria-label": "Audit log" });
  const node = element("details", { class: "audit" }, element("summary", {}, "Audit log: who changed what"), entries);
  node.addEventListener("toggle", () => node.open && show(entries));
  return node;
}

async function show(entries) {
  try {
    const answer = await fetchJson(`/api/v1/audit?limit=${SHOWN}`);
    const nodes = once(answer.entries).reverse().map(entryNode);
    if (answer.problem) {
      nodes.unshift(element("li", { class: "event error" }, `Not all of it is there: ${answer.problem}`));
    }
    entries.replaceChildren(...(nodes.length ? nodes : [element("li", { class: "quiet" }, "Nothing was changed yet.")]));
  } catch (error) {
    entries.replaceChildren(element("li", { class: "quiet" }, `It cannot be read: ${error.message}`));
  }
}

// The intent of a change is shown only while its outcome is missing.
function once(entries) {
  const ended = new Set(entries.filter((entry) => entry.outcome !== BEGUN).map((entry) => entry.data.request));
  return entries.filter((entry) => entry.outcome !== BEGUN || !ended.has(entry.data.request));
}

function entryNode(entry) {
  const outcome = entry.outcome === BEGUN ? "begun, without an outcome so far: look whether it was done" : entry.outcome;
  const text = `${entry.action ?? "unreadable"} ${entry.target ?? ""}: ${entry.problem || outcome} (from ${entry.origin ?? "?"})`;
  return element(
    "li",
    { class: `event ${entry.problem ? "error" : "info"}` },
    element("time", { datetime: entry.time ?? "", title: entry.time ?? "" }, entry.time ? clock(entry.time) : "–"),
    element("span", { class: "event-axis" }, entry.who || "–"),
    element("span", { class: "event-severity" }, `${entry.number}`),
    element("span", { class: "event-text" }, text),
  );
}
