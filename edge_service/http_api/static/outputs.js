// Events that could not be delivered, and what to do about them.

import { button, byId, clock, element, fetchJson, refill, write } from "./dom.js";
import { ifMay, may } from "./session.js";

const RETRY = ["POST", "/api/v1/outputs/{output}/dead"];
const DROP = ["DELETE", "/api/v1/outputs/{output}/dead/{letter}"];

const parts = {};

function build() {
  parts.root = element("div", { id: "outputs" });
  parts.status = element("p", { role: "status" });
  parts.list = element("ul", { class: "plain", "aria-label": "Not delivered" });
  parts.all = element("div", { class: "buttons" });
  parts.root.append(element("h3", {}, "Not delivered"), parts.all, parts.list, ifMay(RETRY, "To try again", () => ""), ifMay(DROP, "To drop one", () => ""), parts.status);
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
  refill(parts.all, JSON.stringify(names), () => names.filter(() => may(RETRY)).map((name) => button(`Try all of ${name} again`, {}, () => act(service, deadOf(name), "POST", "They will be tried again."))));
}

function letterNode(service, letter) {
  const path = `${deadOf(letter.output)}/${encodeURIComponent(letter.id)}`;
  const text = `${clock(letter.time)} ${letter.axis}: ${letter.message} – ${letter.output}: ${letter.reason}, tried ${letter.tries === 1 ? "once" : `${letter.tries} times`}`;
  const again = () => button("Try again", { "aria-label": `Try again: ${letter.message}` }, () => act(service, path, "POST", "It will be tried again."));
  const drop = () => button("Drop", { "aria-label": `Drop: ${letter.message}` }, () => act(service, path, "DELETE", "It is dropped."));
  return element("li", { class: "row" }, text, may(RETRY) ? again() : "", may(DROP) ? drop() : "");
}

const deadOf = (output) => `/api/v1/outputs/${encodeURIComponent(output)}/dead`;

async function act(service, path, method, said) {
  await fetchJson(path, { method }).then(() => write(parts.status, said), (error) => write(parts.status, error.message));
  await loadOutputs(service).catch(() => {});
}
