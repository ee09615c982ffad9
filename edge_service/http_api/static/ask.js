// The question for a name and a note before something is changed.

import { byId, fetchJson, write } from "./dom.js";
import { language, t } from "./strings.js";

// Name of the token that the browser sent; null where none is needed, and a name is typed.
let signedName = null;

export async function findSignedName() {
  signedName = (await fetchJson("/api/v1/tokens")).caller.name;
}

export function ask(axes, command, title, text) {
  write(byId("ask-title"), title);
  write(byId("ask-text"), text);
  write(byId("ask-ok"), title.split(":")[0]);
  write(byId("ask-error"), "");
  byId("ask-user").value = signedName ?? localStorage.getItem("user") ?? "";
  byId("ask-user").readOnly = signedName !== null;
  byId("ask-note").value = "";
  const key = newKey(); // pressed again after a lost answer, it is done once
  byId("ask-form").onsubmit = (event) => {
    event.preventDefault();
    send(axes, key, { ...command, user: byId("ask-user").value.trim(), note: byId("ask-note").value.trim() });
  };
  byId("ask-cancel").onclick = () => byId("ask").close();
  byId("ask").showModal();
}

// Of getRandomValues: randomUUID is missing where the page comes over plain http from another host.
const newKey = () => crypto.getRandomValues(new Uint32Array(4)).join("-");

async function send(axes, key, { occurrences, ...command }) {
  try {
    localStorage.setItem("user", command.user);
    const headers = { "content-type": "application/json", "idempotency-key": `"${key}"` };
    const body = (axis) => JSON.stringify({ ...command, occurrence: occurrences?.[axis] });
    await Promise.all(axes.map((axis) => fetchJson(`/api/v1/axes/${encodeURIComponent(axis)}/commands`, { method: "POST", headers, body: body(axis) })));
    byId("ask").close();
  } catch (error) {
    write(byId("ask-error"), t("ask.refused", { why: error.status === 409 && language !== "en" ? t("ask.nothing") : error.message }));
  }
}
