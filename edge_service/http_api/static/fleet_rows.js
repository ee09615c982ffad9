// Rows of the table of a plant; a click on a name opens the past of its axis beneath.

import { button, element, sentenceOf, symbol } from "./dom.js";
import { day, lasting, number, printed, significant } from "./format.js";
import { pastOf } from "./fleet_past.js";
import { t } from "./strings.js";

export const LEVELS = { FAULT: "act", WARNING: "attention", UNAVAILABLE: "unknown", NORMAL: "ok" };
const open = new Map(); // name -> the row with its past

const nameOf = ({ site, machine, axis }) => `${site} / ${machine} / ${axis}`;

// Rows are kept while they say the same, so that neither a selection nor an open past is disturbed.
export function fillRows(body, rows) {
  const known = new Map([...body.querySelectorAll(".fleet-row")].map((node) => [node.dataset.key, node]));
  const wanted = rows.flatMap((row) => {
    const key = keyOf(row);
    const node = known.get(key) ?? rowNode(row, key);
    const past = open.get(nameOf(row));
    return past ? [node, past] : [node];
  });
  const same = wanted.length === body.children.length && wanted.every((node, i) => node === body.children[i]);
  if (!same) {
    const focused = document.activeElement?.dataset.name;
    body.replaceChildren(...wanted);
    if (focused) [...body.querySelectorAll("[data-name]")].find((node) => node.dataset.name === focused)?.focus();
  }
}

const keyOf = (row) => JSON.stringify([row.address, nameOf(row), ...cellsOf(row)]);

function cellsOf(row) {
  return [row.condition, shareOf(row), row.headline, row.reason, row.task, limitOf(row), lossOf(row), row.age_s === null ? "" : lasting(row.age_s), row.version];
}

function rowNode(row, key) {
  const level = LEVELS[row.condition];
  const node = element("tr", { class: "fleet-row", "data-level": level, "data-key": key });
  const name = button(nameOf(row), { class: "fleet-name", "data-name": nameOf(row), "aria-expanded": String(open.has(nameOf(row))) }, () => toggle(row, node, name));
  const cell = (label, attributes, ...children) => element("td", { ...attributes, ...(children.length ? { "data-label": t(label) } : {}) }, ...children);
  const said = row.headline || sentenceOf(row.reason);
  const more = row.headline && row.reason ? [small(sentenceOf(row.reason), "en")] : [];
  node.append(
    element("td", { "data-wide": "" }, name),
    element("td", {}, element("span", { class: "fleet-condition" }, symbol(level), t(`condition.${row.condition}`))),
    cell("fleet.share", {}, ...(row.share_percent === null ? [] : shareNodes(row))),
    cell("fleet.headline", { "data-wide": "" }, ...(said ? [element("span", { lang: "en" }, said), ...more] : [])),
    cell("fleet.task", { "data-wide": "" }, ...(row.task ? [element("span", { lang: "en" }, row.task)] : [])),
    cell("fleet.limit", {}, ...(limitOf(row) ? [limitOf(row)] : [])),
    cell("fleet.loss", {}, ...lossNodes(row)),
    cell("fleet.age", {}, ...(row.age_s === null ? [] : [lasting(row.age_s)])),
    cell("fleet.version", {}, ...(row.version ? [row.version] : [])),
  );
  return node;
}

const small = (text, lang) => element("span", { class: "fleet-small", ...(lang ? { lang } : {}) }, text);

function printedShare(row) {
  const fresh = row.preload_percent / row.share_percent;
  return printed({ value: row.share_percent, low: row.low / fresh, high: row.high / fresh });
}

function shareOf(row) {
  if (row.share_percent === null) return "";
  return row.low === null || row.share_percent <= 0 ? number(row.share_percent) : printedShare(row).bounds;
}

function shareNodes(row) {
  const value = t("percent", { n: number(row.share_percent) });
  const bounds = row.low === null || row.share_percent <= 0 ? [] : [small(printedShare(row).bounds)];
  return [element("span", { class: "fleet-share" }, value), ...bounds];
}

function limitOf({ limit, limit_earliest, limit_latest }) {
  if (!limit || !limit_earliest) return "";
  const named = t(`fleet.limit.${limit}`);
  return limit_latest ? t("fleet.between", { limit: named, from: day(limit_earliest), to: day(limit_latest) }) : t("fleet.not_before", { limit: named, from: day(limit_earliest) });
}

const lossOf = (row) => JSON.stringify([row.loss_percent_per_1000_h?.map((each) => significant(each)), row.peers?.faster, row.peers && significant(row.peers.peers_loss)]);

function lossNodes({ loss_percent_per_1000_h, peers }) {
  if (!loss_percent_per_1000_h) return [];
  const [value, low, high] = loss_percent_per_1000_h.map((each) => significant(each));
  const isClear = loss_percent_per_1000_h[1] > 0 || loss_percent_per_1000_h[2] < 0;
  const nodes = [element("span", {}, isClear ? t("percent", { n: value }) : t("fleet.no_clear_loss")), small(t("between", { low, high }))];
  if (peers?.faster) nodes.push(element("span", { class: "fleet-faster" }, t("fleet.faster_than", { n: number(peers.peers), loss: significant(peers.peers_loss) })));
  return nodes;
}

function toggle(row, node, name) {
  const known = nameOf(row);
  const opens = !open.has(known);
  name.setAttribute("aria-expanded", String(opens));
  if (opens) {
    open.set(known, element("tr", { class: "fleet-past" }, element("td", { colspan: "9" }, ...pastOf(row))));
    node.after(open.get(known));
  } else {
    open.get(known).remove();
    open.delete(known);
  }
}
