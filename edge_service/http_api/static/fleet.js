// The page of a plant: what it is like as a whole, and every axis of it, worst first.

import { byId, button, element, fetchJson, list, refill, symbol, write } from "./dom.js";
import { fillRows, LEVELS } from "./fleet_rows.js";
import { clock, number } from "./format.js";
import { isSignedOut, signIn } from "./session.js";
import { counted, t, translateDocument } from "./strings.js";

const PERIOD_MS = 2000;
const TYPED_MS = 250;
const PAGE = 200;
const CONDITIONS = ["FAULT", "WARNING", "UNAVAILABLE", "NORMAL"];
const filter = { search: "", site: "", condition: "", faster: false, offset: 0 };
let timer = null;
let asked = 0;
let answeredAt = Date.now();

function address() {
  const wanted = new URLSearchParams({ limit: PAGE, offset: filter.offset });
  for (const name of ["search", "site", "condition"]) if (filter[name]) wanted.set(name, filter[name]);
  if (filter.faster) wanted.set("faster", "true");
  return `/api/v1/fleet?${wanted}`;
}

// A late answer to an older question is not shown.
async function look() {
  clearTimeout(timer);
  asked += 1;
  const mine = asked;
  try {
    const answer = await fetchJson(address());
    if (mine !== asked) return;
    answeredAt = Date.now();
    connected(true);
    render(answer);
  } catch (error) {
    if (mine !== asked) return;
    if (await isSignedOut()) await signIn();
    connected(false);
  }
  timer = setTimeout(look, PERIOD_MS);
}

function connected(yes) {
  byId("connection").dataset.state = yes ? "live" : "lost";
  write(byId("connection-text"), t(yes ? "connection.live" : "connection.lost"));
  byId("banner").hidden = yes;
  document.body.classList.toggle("old", !yes);
  if (!yes) write(byId("banner"), t("banner", { time: clock(answeredAt) }));
}

function render(answer) {
  write(byId("place"), answer.node);
  renderWhole(answer);
  renderFilter(answer);
  fillRows(byId("fleet-rows"), answer.rows);
  renderPages(answer);
  renderNodes(answer.nodes);
}

function renderWhole({ condition, counts, axes, machines, missing, faster }) {
  const level = condition === null ? "unknown" : LEVELS[condition];
  const n = counts[condition] ?? 0;
  const text = condition === null ? t("fleet.none") : level === "ok" ? counted("fleet.ok", axes) : t(`fleet.${level}`, { n: number(n), all: number(axes) });
  byId("fleet-answer").dataset.level = level;
  refill(byId("fleet-title"), `${level} ${text}`, () => [symbol(level), element("span", {}, text)]);
  write(byId("fleet-size"), [counted("fleet.machines", machines), ...(faster ? [counted("fleet.faster", faster)] : [])].join(" · "));
  list(byId("fleet-missing"), missing.map((sentence) => ({ text: sentence, lang: "en" })));
}

function renderFilter({ counts, sites, faster, matching, axes, offset, rows }) {
  const choices = [["", t("fleet.all_sites")], ...sites.map((site) => [site, site])];
  refill(byId("fleet-site"), JSON.stringify(choices), () => choices.map(([value, text]) => element("option", { value }, text)));
  byId("fleet-site").value = filter.site;
  const shown = JSON.stringify([counts, faster, filter]);
  const focused = document.activeElement?.dataset.condition;
  refill(byId("fleet-conditions"), shown, () => [...CONDITIONS.map((each) => choice(each, `${t(`condition.${each}`)} ${number(counts[each])}`, filter.condition === each)), choice("faster", `${t("fleet.outpaces")} ${number(faster)}`, filter.faster)]);
  if (focused) document.querySelector(`[data-condition="${focused}"]`)?.focus();
  const [from, to] = [rows.length ? offset + 1 : 0, offset + rows.length].map((each) => number(each));
  write(byId("fleet-matching"), t("fleet.shown", { from, to, n: number(matching), all: number(axes) }));
}

function choice(code, text, pressed) {
  return button(text, { "data-condition": code, "aria-pressed": String(pressed) }, () => {
    if (code === "faster") filter.faster = !filter.faster;
    else filter.condition = filter.condition === code ? "" : code;
    again();
  });
}

function again() {
  filter.offset = 0;
  look();
}

function renderPages({ offset, matching, rows }) {
  const turn = (by) => () => {
    filter.offset = Math.max(0, filter.offset + by);
    look();
    byId("fleet-list").scrollIntoView();
  };
  refill(byId("fleet-pages"), JSON.stringify([offset, matching, rows.length]), () => [
    ...(offset > 0 ? [button(t("fleet.before"), {}, turn(-PAGE))] : []),
    ...(offset + rows.length < matching ? [button(t("fleet.next"), {}, turn(PAGE))] : []),
  ]);
}

function renderNodes(nodes) {
  refill(byId("fleet-nodes"), JSON.stringify(nodes), () => [element("h2", { id: "fleet-nodes-title" }, t("fleet.nodes")), ...nodes.map(nodeLine)]);
}

function nodeLine({ name, answered, page, parts, machines, problems }) {
  const title = page ? element("a", { href: page }, name) : element("strong", {}, name);
  const words = answered ? t("fleet.node", { parts: number(parts), machines: number(machines) }) : t("fleet.node.silent");
  return element("p", { class: "fleet-node", "data-answered": String(answered) }, title, element("span", {}, words), ...problems.map((each) => element("span", { lang: "en" }, each)));
}

async function start() {
  translateDocument();
  document.title = t("fleet.page");
  byId("fleet-filter").addEventListener("submit", (event) => event.preventDefault());
  byId("fleet-site").addEventListener("change", () => {
    filter.site = byId("fleet-site").value;
    again();
  });
  byId("fleet-search").addEventListener("input", () => {
    filter.search = byId("fleet-search").value.trim();
    clearTimeout(timer);
    timer = setTimeout(again, TYPED_MS);
  });
  await signIn();
  look();
}

start();
