// Forms of the set-up: a card, its fields, and what became of a request.

import { element, write } from "./dom.js";
import { t } from "./strings.js";

export const pathOf = (axis) => `/api/v1/axes/${encodeURIComponent(axis)}/config`;
export const sent = (method, body) => ({ method, headers: { "content-type": "application/json" }, body: JSON.stringify(body) });
export const field = (id, text, node) => element("label", { for: id }, text, node);

export function card(id, ...children) {
  return element("section", { id: `setup-${id}`, class: "panel", "aria-labelledby": `setup-${id}-title` }, element("h2", { id: `setup-${id}-title` }, t(`setup.${id}`)), ...children);
}

// Its button is off while its request is under way; the status below it says what became of that.
export function form(id, fields, action, submit) {
  const status = element("p", { role: "status" });
  const press = element("button", { type: "submit", class: "primary" }, action);
  const node = element("form", { id }, ...fields, element("div", { class: "buttons" }, press), status);
  node.addEventListener("submit", async (event) => {
    event.preventDefault();
    press.disabled = true;
    await act(status, submit());
    press.disabled = false;
  });
  return node;
}

export async function act(status, request) {
  try {
    write(status, (await request) ?? "");
  } catch (error) {
    write(status, t("failed", { why: error.message }));
  }
}
