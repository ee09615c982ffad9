// Events that could not be delivered, and what to do about them.

import { button, byId, element, fetchJson, refill, write } from "./dom.js";
import { clock } from "./format.js";
import { counted, t } from "./strings.js";


const parts = {};

function build() {
  parts.root = element("div", { id: "outputs" });
  parts.status = element("p", { role: "status" });
  parts.list = element("ul", { class: "plain", "aria-label": t("outputs.dead") });
  parts.all = element("div", { class: "buttons" });
  parts.root.append(element("h3", {}, t("outputs.dead")), parts.all, parts.list, parts.status);
  byId("parts").append(parts.root);
}

export async function loadOutputs(service) {
  if (!service?.components.some((each) => "dead_letters" in each.readings)) return;
  const { outputs } = await fetchJson("/api/v1/outputs");
  if (!parts.root) build();
  const letters = outputs.flatMap((each) => each.dead_letters.map((letter) => ({ ...letter, output: each.output })));
  parts.root.hidden = !letters.length && !parts.status.textContent;
  refill(parts.list, JSON.stringify(letters), () => letters.map((letter) => letterNode(service, letter)));
  const names = [...new Set(letters.map((letter) => letter.output))];
  refill(parts.all, JSON.stringify(names), () => names.map((name) => button(t("outputs.retry_all", { name }), {}, () => act(service, deadOf(name), "POST", t("outputs.retried.all")))));
}

function letterNode(service, letter) {
  const path = `${deadOf(letter.output)}/${encodeURIComponent(letter.id)}`;
  const said = element("span", { lang: "en" }, `${letter.axis}: ${letter.message} – ${letter.output}: ${letter.reason}`);
  const again = () => button(t("outputs.retry"), { "aria-label": `${t("outputs.retry")}: ${letter.message}` }, () => act(service, path, "POST", t("outputs.retried")));
  const drop = () => button(t("outputs.drop"), { "aria-label": `${t("outputs.drop")}: ${letter.message}` }, () => act(service, path, "DELETE", t("outputs.dropped")));
  return element("li", { class: "row" }, element("span", {}, clock(letter.time), " ", said, `, ${counted("outputs.tries", letter.tries)}`), again(), drop());
}

const deadOf = (output) => `/api/v1/outputs/${encodeURIComponent(output)}/dead`;

async function act(service, path, method, said) {
  await fetchJson(path, { method }).then(() => write(parts.status, said), (error) => write(parts.status, error.message));
  await loadOutputs(service).catch(() => {});
}
