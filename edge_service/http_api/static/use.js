// What the screw has done: way, hours, reversals, where along the stroke, under which force.

import { byId, element, fetchJson, lasting, refill, svg, write } from "./dom.js";

const parts = {};

function build() {
  parts.facts = element("dl", { class: "facts" });
  parts.map = svg("svg", { class: "bars", role: "img", preserveAspectRatio: "none" });
  parts.spectrum = svg("svg", { class: "bars", role: "img", preserveAspectRatio: "none" });
  parts.mapText = element("p", { class: "quiet" });
  parts.spectrumText = element("p", { class: "quiet" });
  byId("use").replaceChildren(
    element("h2", { id: "use-title" }, "What the screw has done"),
    parts.facts,
    element("div", { class: "small-charts" }, element("div", {}, element("h3", {}, "Where along the stroke"), parts.map, parts.mapText), element("div", {}, element("h3", {}, "Under which mean force"), parts.spectrum, parts.spectrumText)),
  );
}

export async function loadUse(state) {
  if (!parts.facts) build();
  const use = await fetchJson(`/api/v1/axes/${state.axis}/use`);
  if (use === null) return write(parts.mapText, "Nothing counted yet.");
  const facts = [
    ["Way", use.distance_m < 10000 ? `${use.distance_m.toFixed(0)} m` : `${(use.distance_m / 1000).toFixed(1)} km`],
    ["In motion", lasting(use.moving_s)],
    ["Watched", lasting(use.observed_s)],
    ["Reversals", use.reversals.toLocaleString()],
    ["Counted since", new Date(use.since).toLocaleString([], { hour12: false })],
  ];
  refill(parts.facts, JSON.stringify(facts), () => facts.map(([name, text]) => element("div", {}, element("dt", {}, name), element("dd", {}, text))));
  bars(parts.map, use.way_m);
  write(parts.mapText, mapText(use));
  bars(parts.spectrum, use.force_way_m);
  write(parts.spectrumText, spectrumText(use));
}

function bars(node, values) {
  const top = Math.max(...values, 1e-9);
  node.setAttribute("viewBox", `0 0 ${Math.max(values.length, 1)} 100`);
  refill(node, JSON.stringify(values), () => values.map((value, i) => svg("rect", { x: i + 0.08, width: 0.84, y: 100 - (100 * value) / top, height: (100 * value) / top })));
}

function mapText(use) {
  const total = use.way_m.reduce((a, b) => a + b, 0);
  if (total === 0) return "No map: the stroke is not known, or nothing moved.";
  const sorted = [...use.way_m].sort((a, b) => b - a);
  const most = use.way_m.indexOf(sorted[0]);
  const part = (use.stroke_to_m - use.stroke_from_m) / use.way_m.length;
  const at = use.stroke_from_m + (most + 0.5) * part;
  const text = `From ${use.stroke_from_m} m to ${use.stroke_to_m} m; most at ${at.toFixed(2)} m. The busiest quarter has ${Math.round((100 * sorted.slice(0, Math.ceil(sorted.length / 4)).reduce((a, b) => a + b, 0)) / total)} % of the way.`;
  parts.map.setAttribute("aria-label", text);
  return text;
}

function spectrumText(use) {
  const total = use.force_way_m.reduce((a, b) => a + b, 0);
  const shares = use.force_way_m.map((way, i) => [`${use.force_edges_n[i]} to ${use.force_edges_n[i + 1]} N`, way / Math.max(total, 1e-9)]).filter(([, share]) => share > 0.005);
  const text = shares.length ? `${shares.map(([name, share]) => `${name}: ${(100 * share).toFixed(0)} %`).join("; ")} of the way.` : "Nothing moved yet.";
  parts.spectrum.setAttribute("aria-label", text);
  return text;
}
