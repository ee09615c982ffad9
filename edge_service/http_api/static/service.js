// The service's own parts.

import { byId, element, list, write } from "./dom.js";

export function renderService(state, service) {
  const root = byId("parts");
  if (!root.firstChild) {
    root.replaceChildren(element("h2", { id: "parts-title" }, "Service and drivers"), element("p", { id: "service-state" }), element("ul", { class: "components" }));
  }
  if (!service) return;
  const waiting = service.reasons.map((reason) => reason.replace(/: [a-z_]+: /, ": "));
  write(byId("service-state"), service.ready ? "Every axis has fresh input." : `Not ready – ${waiting.join("; ")}.`);
  list(root.querySelector("ul"), [...(state?.health?.components ?? []), ...service.components].map(text));
}

function text(each) {
  const counters = Object.entries(each.counters).map(([name, n]) => `${name.replaceAll("_", " ")} ${n}`);
  const readings = Object.entries(each.readings).map(([name, x]) => `${name.replaceAll("_", " ")} ${x.toFixed(2)}`);
  const details = [...readings, ...counters];
  const reason = each.reason ? ` – ${each.reason}` : "";
  return `${each.component}: ${each.status.replaceAll("_", " ")}${reason}${details.length ? ` (${details.join(", ")})` : ""}`;
}
