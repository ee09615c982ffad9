// Outputs: how each does, a test message, and what it could not deliver.

import { button, byId, element, fetchJson, refill, write } from "./dom.js";
import { t } from "./strings.js";

const parts = {};

function build() {
  parts.status = element("p", { role: "status" });
  parts.list = element("ul", { class: "plain", "aria-label": t("outputs.title") });
  const root = element("div", { id: "outputs" });
  root.append(element("h3", {}, t("outputs.title")), parts.list, parts.status);
  byId("parts").append(root);
}

export async function loadOutputs(service) {
  const { items } = await fetchJson("/api/v1/outputs");
  if (!items.length) return;
  if (!parts.list) build();
  const shown = items.map(({ age_s, ...each }) => each);
  refill(parts.list, JSON.stringify(shown), () => shown.map((each) => outputNode(service, each)));
}

function outputNode(service, { output, state, waiting, dead, reason }) {
  const said = [output, t(`part.${state}`), t("outputs.waiting", { n: waiting }), t("outputs.dead", { n: dead }), reason];
  const actions = dead ? ["test", "requeue", "drop"] : ["test"];
  const ask = (action) => button(t(`outputs.${action}`), { "aria-label": `${t(`outputs.${action}`)}: ${output}` }, () => act(service, output, action));
  return element("li", { class: "row" }, element("span", {}, said.filter(Boolean).join(", ")), ...actions.map(ask));
}

async function act(service, output, action) {
  const body = JSON.stringify({ action });
  await fetchJson(`/api/v1/outputs/${encodeURIComponent(output)}`, { method: "POST", headers: { "content-type": "application/json" }, body }).then(
    () => write(parts.status, t(`outputs.done.${action}`)),
    (error) => write(parts.status, error.message),
  );
  await loadOutputs(service).catch(() => {});
}
