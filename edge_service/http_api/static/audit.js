// Audit log: who changed what, read when somebody opens it.

import { clock, element, fetchJson } from "./dom.js";

const SHOWN = 100;

export function auditNode() {
  const entries = element("ol", { class: "events", tabindex: "0", "aria-label": "Audit log" });
  const node = element("details", { class: "audit" }, element("summary", {}, "Audit log: who changed what"), entries);
  node.addEventListener("toggle", () => node.open && show(entries));
  return node;
}

async function show(entries) {
  try {
    const answer = await fetchJson(`/api/v1/audit?limit=${SHOWN}`);
    const nodes = answer.entries.reverse().map(entryNode);
    if (answer.problem) {
      nodes.unshift(element("li", { class: "event error" }, `Not all of it is there: ${answer.problem}`));
    }
    entries.replaceChildren(...(nodes.length ? nodes : [element("li", { class: "quiet" }, "Nothing was changed yet.")]));
  } catch (error) {
    entries.replaceChildren(element("li", { class: "quiet" }, `It cannot be read: ${error.message}`));
  }
}

function entryNode(entry) {
  const text = `${entry.action ?? "unreadable"} ${entry.target ?? ""}: ${entry.problem || entry.outcome} (from ${entry.origin ?? "?"})`;
  return element(
    "li",
    { class: `event ${entry.problem ? "error" : "info"}` },
    element("time", { datetime: entry.time ?? "", title: entry.time ?? "" }, entry.time ? clock(entry.time) : "–"),
    element("span", { class: "event-axis" }, entry.who || "–"),
    element("span", { class: "event-severity" }, `${entry.number}`),
    element("span", { class: "event-text" }, text),
  );
}
