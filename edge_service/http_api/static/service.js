// The service's own parts: which work, and which do not. Counts of them are for the metrics.

import { reasonWords } from "./advice.js";
import { byId, element, list, withoutCode, write } from "./dom.js";
import { named, t } from "./strings.js";

export function renderService(service) {
  const root = byId("parts");
  if (!root.firstChild) {
    root.replaceChildren(element("h2", { id: "parts-title" }, t("parts")), element("p", { id: "service-state" }), element("ul", { class: "waiting" }), element("table", { class: "components" }, element("tbody", {})), element("p", { id: "versions" }));
  }
  if (!service) return;
  write(byId("service-state"), t(service.ready ? "parts.ready" : "parts.not_ready"));
  list(root.querySelector(".waiting"), service.ready ? [] : service.reasons.map(waitingFor));
  write(byId("versions"), versionWords(service));
  renderRows(root.querySelector("tbody"), service.components);
}

// `X: code: sentence`, or `code: sentence` where it is of no axis.
function waitingFor(reason) {
  const [whole, of, why] = reason.match(/^(?:([^:]+): )?([a-z_]+: .*)$/) ?? [reason, "", reason];
  const { text, lang } = reasonWords(why);
  return lang ? { text: withoutCode(whole), lang } : { text: of ? `${of === "service" ? t("service") : of}: ${text}` : text };
}

function versionWords({ version, configuration }) {
  if (!version) return "";
  if (!configuration) return t("parts.version", { version });
  return t("parts.version_configured", { version, configuration });
}

function renderRows(body, components) {
  const key = JSON.stringify(components.map(({ component, axis, status, reason }) => [component, axis, status, reason]));
  if (body.dataset.key === key) return;
  body.dataset.key = key;
  body.replaceChildren(...components.map(rowNode));
}

function rowNode({ component, axis, status, reason }) {
  const words = named("component", component.replace(/_process$/, ""));
  const name = axis ? t("parts.of_axis", { part: words, axis }) : words;
  return element("tr", { "data-state": status === "ok" ? "ok" : "faulty" }, element("th", { scope: "row" }, name), element("td", {}, named("part", status)), element("td", { lang: "en" }, reason));
}
