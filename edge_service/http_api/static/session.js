// Who looks at the page: by the session of a token, where the service asks for one.

import { byId, element, fetchJson, write } from "./dom.js";
import { t } from "./strings.js";

const SESSION = "/api/v1/session";
const RANKS = ["nobody", "viewer", "operator", "admin"];
let who = null;
let builtFor = null;

export const signedName = () => who?.name ?? null;

// A right is [method, path as the table of rights writes it].
const needed = ([method, path]) => who?.rights[path]?.[method] ?? "admin";
export const may = (right) => RANKS.indexOf(who?.role) >= RANKS.indexOf(needed(right));

// What only some may do; for all others the reason why it is not there, by the key `may.what`.
export function ifMay(right, what, make) {
  if (may(right)) return make();
  return element("p", { class: "quiet not-allowed" }, t("may", { what: t(`may.${what}`), needed: t(`role.${needed(right)}`), yours: t(`role.${who.role}`) }));
}

export async function isSignedOut() {
  const answer = await fetchJson(SESSION).catch(() => null);
  return answer?.role === "nobody";
}

// Resolves once somebody is there who may look.
export async function signIn() {
  who = await fetchJson(SESSION);
  if (who.role === "nobody") await askForToken();
  if (builtFor !== null && builtFor !== who.role) return location.reload();
  builtFor = who.role;
  byId("who").hidden = who.name === null;
  write(byId("who-name"), `${who.name} (${t(`role.${who.role}`)})`);
}

function askForToken() {
  show(true);
  return new Promise((done) => {
    byId("sign-in-form").onsubmit = (event) => {
      event.preventDefault();
      send(byId("token").value.trim()).then(done, (error) => write(byId("sign-in-error"), t("sign_in.refused", { why: error.message })));
    };
  });
}

async function send(token) {
  write(byId("sign-in-error"), "");
  who = await fetchJson(SESSION, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify({ token }) });
  byId("token").value = "";
  show(false);
}

function show(asking) {
  byId("sign-in").hidden = !asking;
  byId("main").hidden = asking;
  document.body.classList.toggle("signed-out", asking);
  if (asking) byId("token").focus();
}

byId("sign-out").addEventListener("click", async () => {
  await fetch(SESSION, { method: "DELETE" });
  location.reload();
});
