// The past of one axis of a plant, as the log of its machine tells it.

import { atTime, axis as axisOf, Chart, colour, range, reader, spoken, timeAxis } from "./charts.js";
import { button, element, fetchJson, list } from "./dom.js";
import { number } from "./format.js";
import { may } from "./session.js";
import { t } from "./strings.js";

const REMOVE = ["DELETE", "/api/v1/fleet/{site}/{machine}"];

export function pastOf({ site, machine, axis, address, condition }) {
  const status = element("p", { class: "quiet", role: "status" }, t("fleet.past.loading"));
  const holder = element("div", { class: "chart tall" });
  const notes = element("ul", { class: "reasons" });
  const links = element("p", {});
  if (/^https?:\/\//.test(address)) links.append(element("a", { href: address, rel: "noopener" }, t("fleet.own_page")));
  if (condition === "UNAVAILABLE" && may(REMOVE)) links.append(removal([site, machine]));
  load([site, machine, axis], status, holder, notes);
  return [links, status, element("div", {}, holder), notes];
}

// A machine that is gone for good; it comes back by itself when it is heard again.
function removal(names) {
  const remove = button(t("fleet.remove", { machine: names.join(" / ") }), {}, async () => {
    remove.disabled = true;
    const path = `/api/v1/fleet/${names.map(encodeURIComponent).join("/")}`;
    const answer = await fetch(path, { method: "DELETE" }).catch(() => null);
    remove.textContent = t(answer?.ok ? "fleet.removed" : "fleet.not_removed");
    remove.disabled = answer?.ok ?? false;
  });
  return remove;
}

async function load(names, status, holder, notes) {
  try {
    const past = await fetchJson(`/api/v1/fleet/${names.map(encodeURIComponent).join("/")}/history`);
    const known = past.points.filter((point) => point.share_percent !== null);
    list(notes, [...past.holes.map((hole) => ({ text: t("fleet.past.hole", { n: number(hole.last - hole.first + 1) }) })), ...past.missing.map((text) => ({ text, lang: "en" }))]);
    status.textContent = t(past.points.length ? "fleet.past.reports" : "fleet.past.none", { n: number(past.points.length) });
    holder.hidden = known.length === 0;
    if (known.length) draw(holder, past.points);
  } catch (error) {
    status.textContent = t("failed", { why: error.message });
    holder.hidden = true;
  }
}

// A time without a number is a gap in the line.
function draw(holder, points) {
  const scaled = (point, bound) => (point.share_percent === null || point[bound] === null ? null : (point[bound] * point.share_percent) / point.preload_percent);
  const data = [points.map((point) => Date.parse(point.time) / 1000), points.map((point) => point.share_percent), points.map((point) => scaled(point, "low")), points.map((point) => scaled(point, "high"))];
  const line = (name, width) => ({ stroke: colour(name), width, points: { show: points.length < 3 } });
  const options = (width) => ({ width, height: 240, scales: { y: { range: range(0, 100) } }, axes: [timeAxis(), axisOf()], series: [{}, line("accent", 2), line("quiet", 1), line("quiet", 1)] });
  const chart = new Chart(holder, options, (all) => spoken(all[1], t("unit.fresh")), reader(atTime, [1, t("unit.fresh"), ""]));
  requestAnimationFrame(() => chart.set(data));
}
