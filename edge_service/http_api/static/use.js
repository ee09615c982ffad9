// What the screw has done: way, hours, reversals, under which force; and along the stroke, one
// above the other, where it worked, its preload and its stiffness.

import { byId, element, fetchJson, refill, svg, write } from "./dom.js";
import { clock, lasting, number } from "./format.js";
import { t } from "./strings.js";
import { Chart, axis, colour, range, reader, spoken } from "./charts.js";

let parts = {};
const stroke = [0, 1]; // mm
const MM = 1000; // per m
const atMm = (place) => `${number(place)} ${t("unit.mm")}`;

function build() {
  parts = {};
  parts.facts = element("dl", { class: "facts" });
  parts.spectrum = svg("svg", { class: "bars", role: "img", preserveAspectRatio: "none", "aria-label": t("chart.none") });
  const text = (name) => (parts[name] = element("p", { class: "quiet" }));
  const holder = (name) => (parts[`${name}Holder`] = element("div", { class: "chart" }));
  const titled = (title, ...nodes) => element("div", {}, element("h3", {}, title), ...nodes);
  byId("use").replaceChildren(
    element("h2", { id: "use-title" }, t("use")),
    parts.facts,
    element("div", { class: "small-charts two", id: "stroke" },
      titled(t("use.map"), holder("map"), text("mapText")),
      titled(t("use.preload"), holder("preload"), text("preloadText")),
      titled(t("use.stiffness"), holder("stiffness"), text("stiffnessText")),
      titled(t("use.spectrum"), parts.spectrum, text("spectrumText"))),
    element("p", { class: "legend quiet" }, element("span", { class: "key line" }, t("legend.now")), element("span", { class: "key band" }, t("legend.interval")), element("span", { class: "key first" }, t("legend.commissioned"))),
  );
  parts.map = new Chart(parts.mapHolder, mapOptions, ([, way]) => `${t("use.map.label")}: ${spoken(way, t("unit.m"))}`, reader(atMm, [1, t("unit.m")]));
  parts.preload = new Chart(parts.preloadHolder, bandOptions, ([, , , now]) => `${t("use.preload.label")}: ${spoken(now, "%")}`, reader(atMm, [3, "%"], [4, "%", t("legend.commissioned")]));
  parts.stiffness = new Chart(parts.stiffnessHolder, bandOptions, ([, , , now]) => `${t("use.stiffness.label")}: ${spoken(now, t("unit.n_per_um"))}`, reader(atMm, [3, t("unit.n_per_um")], [4, t("unit.n_per_um"), t("legend.commissioned")]));
}

function alongStroke(width, series, more) {
  return { width, height: 150, scales: { x: { time: false, range: () => stroke }, y: { range: range(0) } }, axes: [axis({ space: 60, size: 30 }), axis({ size: 44, space: 26 })], series: [{}, ...series], ...more };
}

function mapOptions(width) {
  return alongStroke(width, [{ fill: colour("accent"), stroke: colour("accent"), width: 0, paths: uPlot.paths.bars({ size: [0.85, 60] }), points: { show: false } }]);
}

function bandOptions(width) {
  const bare = { points: { show: false } };
  const series = [
    { stroke: "transparent", ...bare },
    { stroke: "transparent", ...bare },
    { stroke: colour("accent"), width: 2, ...bare },
    { stroke: colour("quiet"), width: 1.5, dash: [5, 4], ...bare },
  ];
  return alongStroke(width, series, { bands: [{ series: [1, 2], fill: `${colour("accent")}38` }] });
}

export async function loadUse(state) {
  if (!byId("use").firstChild) build();
  const asking = parts;
  const path = `/api/v1/axes/${encodeURIComponent(state.axis)}`;
  const { use, stroke: along } = await fetchJson(`${path}/wear`);
  if (asking !== parts) return; // another axis is shown by now
  if (use !== null) renderUse(use);
  else write(parts.mapText, t("use.nothing"));
  renderStroke(along);
}

function renderUse(use) {
  const facts = [
    [t("use.way"), use.distance_m < 10000 ? `${number(use.distance_m)} ${t("unit.m")}` : `${number(use.distance_m / 1000, 1)} ${t("unit.km")}`],
    [t("use.moving"), lasting(use.moving_s)],
    [t("use.observed"), lasting(use.observed_s)],
    [t("use.reversals"), number(use.reversals)],
    [t("use.since"), clock(use.since)],
  ];
  refill(parts.facts, JSON.stringify(facts), () => facts.map(([name, text]) => element("div", {}, element("dt", {}, name), element("dd", {}, text))));
  [stroke[0], stroke[1]] = [MM * use.stroke_from_m, MM * Math.max(use.stroke_to_m, use.stroke_from_m + 1e-3)];
  const part = (use.stroke_to_m - use.stroke_from_m) / Math.max(use.way_m.length, 1);
  parts.map.set([use.way_m.map((_, i) => MM * (use.stroke_from_m + (i + 0.5) * part)), use.way_m]);
  write(parts.mapText, mapText(use, part));
  bars(parts.spectrum, use.force_way_m);
  write(parts.spectrumText, spectrumText(use));
}

function renderStroke(along) {
  const show = (chart, holder, profile, scale) => {
    holder.hidden = !profile;
    if (!profile) return;
    const column = (values) => (values ?? along.position_m.map(() => null)).map((value) => value && value * scale);
    chart.set([along.position_m.map((at) => MM * at), column(profile.high), column(profile.low), column(profile.value), column(profile.commissioned)]);
  };
  show(parts.preload, parts.preloadHolder, along?.preload_percent, 1);
  show(parts.stiffness, parts.stiffnessHolder, along?.stiffness_n_per_m, 1e-6);
  write(parts.preloadText, along ? `${changeText(along.preload_percent)} ${t("use.preload.shape")}` : t("use.not_commissioned"));
  write(parts.stiffnessText, !along ? t("use.not_commissioned") : along.stiffness_n_per_m ? `${changeText(along.stiffness_n_per_m)} ${t("use.stiffness.implied")}` : t("use.stiffness.unknown"));
}

function changeText({ commissioned, value, low, high }) {
  if (value === null) return t("use.no_estimate");
  const middle = Math.floor(value.length / 2);
  const share = (bound) => number((100 * bound[middle]) / commissioned[middle]);
  return t("use.at_middle", { value: share(value), low: share(low), high: share(high) });
}

function bars(node, values) {
  const top = Math.max(...values, 1e-9);
  node.setAttribute("viewBox", `0 0 ${Math.max(values.length, 1)} 100`);
  refill(node, JSON.stringify(values), () => values.map((value, i) => svg("rect", { x: i + 0.08, width: 0.84, y: 100 - (100 * value) / top, height: (100 * value) / top })));
}

function mapText(use, part) {
  const total = use.way_m.reduce((a, b) => a + b, 0);
  if (total === 0) return t("use.no_map");
  const sorted = [...use.way_m].sort((a, b) => b - a);
  const at = use.stroke_from_m + (use.way_m.indexOf(sorted[0]) + 0.5) * part;
  const quarter = sorted.slice(0, Math.ceil(sorted.length / 4)).reduce((a, b) => a + b, 0);
  const mm = (metres) => number(MM * metres);
  return t("use.map.text", { from: mm(use.stroke_from_m), to: mm(use.stroke_to_m), at: mm(at), share: number((100 * quarter) / total) });
}

function spectrumText(use) {
  const total = use.force_way_m.reduce((a, b) => a + b, 0);
  const shares = use.force_way_m.map((way, i) => [i, way / Math.max(total, 1e-9)]).filter(([, share]) => share > 0.005);
  const words = ([i, share]) => t("use.force", { low: number(use.force_edges_n[i]), high: number(use.force_edges_n[i + 1]), share: number(100 * share) });
  const text = shares.length ? t("use.spectrum.text", { shares: shares.map(words).join("; ") }) : t("use.spectrum.none");
  parts.spectrum.setAttribute("aria-label", text);
  return text;
}
