// Audit log: who changed what, read when somebody opens it.

import { byId, element, fetchJson } from "./dom.js";
import { clock } from "./format.js";
import { ifMay } from "./session.js";
import { t } from "./strings.js";

const AUDIT = ["GET", "/api/v1/audit"];
const SHOWN = 200;
const BEGUN = "begun";

export function buildAudit() {
  if (!byId("audit").firstChild) byId("audit").append(ifMay(AUDIT, "audit", auditNode));
}

function auditNode() {
  const entries = element("ol", { class: "events", tabindex: "0", "aria-label": t("audit") });
  const node = element("details", { class: "audit" }, element("summary", {}, t("audit.title")), entries);
  node.addEventListener("toggle", () => node.open && show(entries));
  return node;
}

async function show(entries) {
  try {
    const answer = await fetchJson(`/api/v1/audit?limit=${SHOWN}`);
    const nodes = once(answer.entries).reverse().map(entryNode);
    if (answer.problem) {
      nodes.unshift(element("li", { class: "event error" }, t("audit.damaged"), " ", element("span", { lang: "en" }, answer.problem)));
    }
    entries.replaceChildren(...(nodes.length ? nodes : [element("li", { class: "quiet" }, t("audit.empty"))]));
  } catch (error) {
    entries.replaceChildren(element("li", { class: "quiet" }, t("audit.unreadable"), " ", element("span", { lang: "en" }, error.message)));
  }
}

// The intent of a change is shown only while its outcome is missing.
function once(entries) {
  const ended = new Set(entries.filter((entry) => entry.outcome !== BEGUN).map((entry) => entry.data.request));
  return entries.filter((entry) => entry.outcome !== BEGUN || !ended.has(entry.data.request));
}

function entryNode(entry) {
  const outcome = entry.problem || (entry.outcome === BEGUN ? t("audit.begun") : entry.outcome);
  return element(
    "li",
    { class: `event ${entry.problem ? "error" : "info"}` },
    element("time", { datetime: entry.time ?? "", title: entry.time ?? "" }, entry.time ? clock(entry.time) : "–"),
    element("span", { class: "event-axis" }, entry.who || "–"),
    element("span", { class: "event-severity" }, `${entry.number}`),
    element("span", { class: "event-text", lang: "en" }, `${entry.action ?? "–"} ${entry.target ?? ""}: ${outcome} (${t("audit.from", { origin: entry.origin ?? "–" })})`),
  );
}
