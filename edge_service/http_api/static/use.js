// What the screw has done: way, hours, reversals, under which force; and along the stroke, one
// above the other, where it worked, its preload and its stiffness.

import { byId, element, fetchJson, lasting, refill, svg, write } from "./dom.js";
import { Chart, axis, colour, range, spoken } from "./charts.js";

const parts = {};
const stroke = [0, 1];

function build() {
  parts.facts = element("dl", { class: "facts" });
  parts.spectrum = svg("svg", { class: "bars", role: "img", preserveAspectRatio: "none" });
  const text = (name) => (parts[name] = element("p", { class: "quiet" }));
  const holder = (name) => (parts[`${name}Holder`] = element("div", { class: "chart" }));
  const titled = (title, ...nodes) => element("div", {}, element("h3", {}, title), ...nodes);
  byId("use").replaceChildren(
    element("h2", { id: "use-title" }, "What the screw has done, and how it is along its stroke"),
    parts.facts,
    element("div", { class: "small-charts two", id: "stroke" },
      titled("Way worked along the stroke, m over m", holder("map"), text("mapText")),
      titled("Preload along the stroke, % over m", holder("preload"), text("preloadText")),
      titled("Stiffness along the stroke, N/µm over m", holder("stiffness"), text("stiffnessText")),
      titled("Way worked under which mean force", parts.spectrum, text("spectrumText"))),
    element("p", { class: "legend quiet" }, element("span", { class: "key line" }, "now"), element("span", { class: "key band" }, "interval"), element("span", { class: "key first" }, "when commissioned")),
  );
  parts.map = new Chart(parts.mapHolder, mapOptions, ([, way]) => `Way worked along the stroke: ${spoken(way, "metres")}`);
  parts.preload = new Chart(parts.preloadHolder, bandOptions, ([, , , now]) => `Preload along the stroke: ${spoken(now, "percent")}`);
  parts.stiffness = new Chart(parts.stiffnessHolder, bandOptions, ([, , , now]) => `Stiffness along the stroke: ${spoken(now, "newtons per micrometre")}`);
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
  if (!parts.facts) build();
  const path = `/api/v1/axes/${state.axis}`;
  const [use, along] = await Promise.all([fetchJson(`${path}/use`), fetchJson(`${path}/stroke`)]);
  if (use !== null) renderUse(use);
  else write(parts.mapText, "Nothing counted yet.");
  renderStroke(along);
}

function renderUse(use) {
  const facts = [
    ["Way", use.distance_m < 10000 ? `${use.distance_m.toFixed(0)} m` : `${(use.distance_m / 1000).toFixed(1)} km`],
    ["In motion", lasting(use.moving_s)],
    ["Watched", lasting(use.observed_s)],
    ["Reversals", use.reversals.toLocaleString()],
    ["Counted since", new Date(use.since).toLocaleString([], { hour12: false })],
  ];
  refill(parts.facts, JSON.stringify(facts), () => facts.map(([name, text]) => element("div", {}, element("dt", {}, name), element("dd", {}, text))));
  [stroke[0], stroke[1]] = [use.stroke_from_m, Math.max(use.stroke_to_m, use.stroke_from_m + 1e-3)];
  const part = (use.stroke_to_m - use.stroke_from_m) / Math.max(use.way_m.length, 1);
  parts.map.set([use.way_m.map((_, i) => use.stroke_from_m + (i + 0.5) * part), use.way_m]);
  write(parts.mapText, mapText(use, part));
  bars(parts.spectrum, use.force_way_m);
  write(parts.spectrumText, spectrumText(use));
}

function renderStroke(along) {
  const show = (chart, holder, profile, scale) => {
    holder.hidden = !profile;
    if (!profile) return;
    const column = (values) => (values ?? along.position_m.map(() => null)).map((value) => value && value * scale);
    chart.set([along.position_m, column(profile.high), column(profile.low), column(profile.value), column(profile.commissioned)]);
  };
  show(parts.preload, parts.preloadHolder, along?.preload_percent, 1);
  show(parts.stiffness, parts.stiffnessHolder, along?.stiffness_n_per_m, 1e-6);
  write(parts.preloadText, along ? `${changeText(along.preload_percent)} Its level is the estimate's, its shape that of the commissioned axis.` : "Not known: this axis is not commissioned (edge-service commission).");
  write(parts.stiffnessText, !along ? "Not known: this axis is not commissioned." : along.stiffness_n_per_m ? `${changeText(along.stiffness_n_per_m)} What the preload implies; a fingerprint test measures it.` : "Not known: it takes a linear encoder and the mass of the table.");
}

function changeText({ commissioned, value, low, high }) {
  if (value === null) return "No estimate now.";
  const middle = Math.floor(value.length / 2);
  const share = (bound) => Math.round((100 * bound[middle]) / commissioned[middle]);
  return `At mid-stroke ${share(value)} % of the commissioned one (95 % sure: ${share(low)} to ${share(high)} %).`;
}

function bars(node, values) {
  const top = Math.max(...values, 1e-9);
  node.setAttribute("viewBox", `0 0 ${Math.max(values.length, 1)} 100`);
  refill(node, JSON.stringify(values), () => values.map((value, i) => svg("rect", { x: i + 0.08, width: 0.84, y: 100 - (100 * value) / top, height: (100 * value) / top })));
}

function mapText(use, part) {
  const total = use.way_m.reduce((a, b) => a + b, 0);
  if (total === 0) return "No map: the stroke is not known, or nothing moved.";
  const sorted = [...use.way_m].sort((a, b) => b - a);
  const at = use.stroke_from_m + (use.way_m.indexOf(sorted[0]) + 0.5) * part;
  const quarter = sorted.slice(0, Math.ceil(sorted.length / 4)).reduce((a, b) => a + b, 0);
  return `From ${use.stroke_from_m} m to ${use.stroke_to_m} m; most at ${at.toFixed(2)} m. The busiest quarter has ${Math.round((100 * quarter) / total)} % of the way.`;
}

function spectrumText(use) {
  const total = use.force_way_m.reduce((a, b) => a + b, 0);
  const shares = use.force_way_m.map((way, i) => [`${use.force_edges_n[i]} to ${use.force_edges_n[i + 1]} N`, way / Math.max(total, 1e-9)]).filter(([, share]) => share > 0.005);
  const text = shares.length ? `${shares.map(([name, share]) => `${name}: ${(100 * share).toFixed(0)} %`).join("; ")} of the way.` : "Nothing moved yet.";
  parts.spectrum.setAttribute("aria-label", text);
  return text;
}
