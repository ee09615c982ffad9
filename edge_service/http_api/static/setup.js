// Setting up: axes that are made here, their limits, and the tokens that let people in.

import { button, byId, element, fetchJson, refill } from "./dom.js";
import { firstCard, knowAxes } from "./first.js";
import { act, card, field, form, pathOf, sent } from "./form.js";
import { clock } from "./format.js";
import { t } from "./strings.js";

const DRIVERS = ["folder", "modbus", "mqtt", "opcua", "replay", "simulated"];
const ROLES = ["viewer", "operator"];
const LIMITS = ["warning_percent", "fault_percent"];
const parts = {};

const changed = (status, request) => act(status, request).then(loadSetup).catch(() => {});

// A value as TOML, in one line.
function toml(value) {
  if (Array.isArray(value)) return `[${value.map(toml).join(", ")}]`;
  if (typeof value === "object") return `{ ${Object.entries(value).map(([key, each]) => `${JSON.stringify(key)} = ${toml(each)}`).join(", ")} }`;
  return JSON.stringify(value);
}

function build() {
  parts.axes = element("ul", { class: "plain", "aria-label": t("axes") });
  parts.name = element("input", { id: "setup-name", required: "", maxlength: "100" });
  parts.driver = element("input", { id: "setup-driver", required: "", list: "setup-drivers" });
  parts.settings = element("textarea", { id: "setup-settings", rows: "6", spellcheck: "false" });
  parts.machine = element("textarea", { id: "setup-machine", rows: "6", spellcheck: "false" });
  parts.limits = element("ul", { class: "plain", "aria-label": t("setup.limits") });
  parts.limitStatus = element("p", { role: "status" });
  parts.tokens = element("ul", { class: "plain", "aria-label": t("setup.tokens") });
  parts.person = element("input", { id: "setup-person", required: "", maxlength: "60" });
  parts.role = element("select", { id: "setup-role" }, ...ROLES.map((value) => element("option", { value }, t(`role.${value}`))));
  const drivers = element("datalist", { id: "setup-drivers" }, ...DRIVERS.map((value) => element("option", { value })));
  const axis = [field("setup-name", t("setup.name"), parts.name), field("setup-driver", t("setup.driver"), parts.driver), drivers, field("setup-settings", t("setup.settings"), parts.settings), field("setup-machine", t("setup.machine"), parts.machine)];
  const token = [field("setup-person", t("setup.person"), parts.person), field("setup-role", t("setup.role"), parts.role)];
  byId("setup").replaceChildren(
    firstCard(),
    card("axis", element("p", { class: "quiet" }, t("setup.axis.text")), parts.axes, form("setup-form", axis, t("setup.save"), saveAxis)),
    card("limits", element("p", { class: "quiet" }, t("setup.limits.text")), parts.limits, parts.limitStatus),
    card("tokens", element("p", { class: "quiet" }, t("setup.tokens.text")), parts.tokens, form("token-form", token, t("setup.token.add"), addToken)),
  );
}

export async function loadSetup() {
  if (!parts.axes) build();
  const [{ axes }, { items: tokens }] = await Promise.all([fetchJson("/api/v1/axes"), fetchJson("/api/v1/tokens")]);
  const names = axes.map(({ axis }) => axis).sort();
  const configured = await Promise.all(names.map((name) => fetchJson(pathOf(name))));
  knowAxes(configured);
  refill(parts.axes, JSON.stringify(configured), () => configured.map(axisNode));
  refill(parts.limits, JSON.stringify(configured), () => configured.map(limitNode));
  refill(parts.tokens, JSON.stringify(tokens), () => (tokens.length ? tokens.map(tokenNode) : [element("li", { class: "quiet" }, t("setup.tokens.none"))]));
}

function axisNode(config) {
  const change = button(t("setup.change"), { "aria-label": `${t("setup.change")} ${config.axis}` }, () => fill(config));
  const remove = button(t("remove"), { "aria-label": `${t("remove")} ${config.axis}` }, () => changed(byId("setup-form").querySelector("[role=status]"), removed(config.axis)));
  return element("li", { class: "row" }, element("b", {}, config.axis), element("span", { lang: "en" }, config.driver), change, remove);
}

function fill({ axis, driver, settings, limits }) {
  parts.filled = { axis, limits };
  parts.name.value = axis;
  parts.driver.value = driver;
  parts.settings.value = Object.entries(settings).map(([key, value]) => `${key} = ${toml(value)}\n`).join("");
  parts.machine.value = "";
  parts.name.focus();
}

async function saveAxis() {
  const axis = parts.name.value.trim();
  const machine = parts.machine.value.trim() || null;
  const limits = parts.filled?.axis === axis ? parts.filled.limits : {};
  await fetchJson(pathOf(axis), sent("PUT", { driver: parts.driver.value.trim(), settings: parts.settings.value, limits, machine }));
  location.assign(`#/${encodeURIComponent(axis)}`);
  location.reload();
}

async function removed(axis) {
  await fetchJson(pathOf(axis), { method: "DELETE" });
  location.reload();
}

function limitNode(config) {
  const inputs = LIMITS.map((name) => {
    const id = `limit-${name}-${config.axis}`;
    return [name, element("input", { id, type: "number", min: "0", max: "100", step: "any", value: config.limits[name] }), id];
  });
  const save = async () => {
    const limits = Object.fromEntries(inputs.map(([name, node]) => [name, Number(node.value)]));
    await fetchJson(pathOf(config.axis), sent("PUT", { ...config, limits }));
    return t("setup.limits.saved", { axis: config.axis });
  };
  const fields = inputs.map(([name, node, id]) => field(id, t(`setup.${name}`), node));
  return element("li", { class: "row limits" }, element("b", {}, config.axis), ...fields, button(t("setup.save"), { "aria-label": `${t("setup.save")} ${config.axis}` }, () => changed(parts.limitStatus, save())));
}

function tokenNode({ name, role, used_at: used }) {
  const revoke = () => changed(byId("token-form").querySelector("[role=status]"), fetchJson(`/api/v1/tokens/${encodeURIComponent(name)}`, { method: "DELETE" }).then(() => t("removed")));
  const about = `${t(`role.${role}`)}, ${used ? t("setup.token.used", { time: clock(used) }) : t("setup.token.unused")}`;
  return element("li", { class: "row" }, element("b", {}, name), element("span", {}, about), button(t("setup.token.revoke"), { "aria-label": `${t("setup.token.revoke")} ${name}` }, revoke));
}

async function addToken() {
  const { token } = await fetchJson("/api/v1/tokens", sent("POST", { name: parts.person.value.trim(), role: parts.role.value }));
  loadSetup().catch(() => {});
  return t("setup.token.shown", { token });
}
