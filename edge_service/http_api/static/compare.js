// Two fingerprints side by side.

import { element, fetchJson } from "./dom.js";
import { significant } from "./format.js";
import { t } from "./strings.js";

const READABLE = { m: [1e6, "µm"], "N/m": [1e-6, "N/µm"], "kg m^2": [1e4, "kg cm²"] };
const UNIT_IN_NAME = /_(n_per_m|hz|m|kg_m2|nm_s_per_rad|nm|n|rad)$/;

export async function comparison(numbers) {
  const [left, right] = await Promise.all(numbers.map((number) => fetchJson(`/api/v1/jobs/${number}/files/fingerprint.json`)));
  const sections = new Set([...Object.keys(left.sections), ...Object.keys(right.sections)]);
  const rows = [...sections].flatMap((section) => rowsOf(section, left.sections[section]?.figures ?? {}, right.sections[section]?.figures ?? {}));
  const head = ["test", "figure", "left", "right", "changed"].map((name) => element("th", { scope: "col" }, t(`compare.${name}`)));
  return element("table", {}, element("thead", {}, element("tr", {}, ...head)), element("tbody", {}, ...rows));
}

function rowsOf(section, left, right) {
  return [...new Set([...Object.keys(left), ...Object.keys(right)])].map((name) => row(section, name, left[name], right[name]));
}

function row(section, name, left, right) {
  const known = left?.low != null && right?.low != null;
  const changed = known ? (left.high < right.low || right.high < left.low ? "yes" : "no") : "unknown";
  const words = [section, name.replace(UNIT_IN_NAME, "").replaceAll("_", " ")].map((text) => element("td", { lang: "en" }, text));
  return element("tr", { "data-state": changed === "yes" ? "faulty" : "ok" }, ...words, ...[shown(left), shown(right)].map((text) => element("td", { lang: "en" }, text)), element("td", {}, t(`compare.${changed}`)));
}

function shown(figure) {
  if (figure?.value == null) return "–";
  const [scale, unit] = READABLE[figure.unit] ?? [1, figure.unit];
  const digits = (value) => significant(scale * value, 4);
  return figure.low == null ? `${digits(figure.value)} ${unit}` : `${digits(figure.value)} ${unit} (${t("between", { low: digits(figure.low), high: digits(figure.high) })})`;
}
