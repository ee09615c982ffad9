// What the axis does right now: the last minute of four signals.

import { byId, element, fetchJson } from "./dom.js";
import { Chart, atTime, axis, colour, range, reader, spoken, timeAxis } from "./charts.js";
import { t } from "./strings.js";

const SPAN_S = 60;
const HOLE_S = 1;
const R_MIN_PER_RAD_S = 30 / Math.PI;
// Signal, its unit on the page, that unit per unit of the service, and the least span shown.
const SIGNALS = [
  ["torque_nm", "unit.nm", 1, 0.1],
  ["speed_rad_s", "unit.r_min", R_MIN_PER_RAD_S, 10],
  ["position_m", "unit.mm", 1000, 1],
  ["transmission_m", "unit.um", 1e6, 0.2],
];
const charts = new Map();
const columns = { axis: null, time_s: [] };
let fresh = false;

function build(root) {
  const grid = element("div", { class: "small-charts four" });
  for (const [name, unitKey, , least] of SIGNALS) {
    const [title, unit] = [t(`trace.${name}`), t(unitKey)];
    const holder = element("div", { class: "chart", id: `trace-${name}` });
    grid.append(element("div", {}, element("h3", {}, `${title}, ${unit}`), holder));
    charts.set(name, new Chart(holder, (width) => options(width, least), ([, values]) => `${t("trace.last_minute", { title })}: ${spoken(values, unit)}`, reader(atTime, [1, unit])));
  }
  root.replaceChildren(element("h2", { id: "traces-title" }, t("traces")), grid);
}

function options(width, least) {
  return {
    width,
    height: 130,
    scales: { x: { range: () => [columns.endS - SPAN_S, columns.endS] }, y: { range: (self, low, high) => range(low === null ? 0 : Math.min(low, high - least), null)(self, low, high) } },
    axes: [timeAxis(), axis({ size: 58, space: 24 })],
    series: [{}, { stroke: colour("accent"), width: 1.5, points: { show: false }, spanGaps: false }],
  };
}

export async function startTraces(state) {
  if (charts.size === 0) build(byId("traces"));
  columns.axis = state.axis;
  empty();
  const answer = await fetchJson(`/api/v1/axes/${encodeURIComponent(state.axis)}/live?duration=${SPAN_S}`).catch(() => null);
  if (answer === null || columns.axis !== answer.axis) return;
  empty();
  answer.time_s.forEach((time, i) => add(time, (name) => answer[name][i]));
}

function empty() {
  columns.time_s = [];
  for (const [name] of SIGNALS) columns[name] = [];
  fresh = true;
}

// A hole in the data is a hole in the line.
function add(time, valueOf) {
  const last = columns.time_s.at(-1) ?? time;
  if (time - last > HOLE_S) {
    columns.time_s.push(last + HOLE_S / 2);
    for (const [name] of SIGNALS) columns[name].push(null);
  }
  columns.time_s.push(time);
  for (const [name, , scale] of SIGNALS) columns[name].push(valueOf(name) == null ? null : scale * valueOf(name));
}

export function takeLive(answer) {
  if (answer.axis !== columns.axis) return;
  const time = Date.parse(answer.time) / 1000;
  const last = columns.time_s.at(-1) ?? -Infinity;
  if (time <= last) return;
  add(time, (name) => answer[name]);
  fresh = true;
}

function forget(endS) {
  const kept = columns.time_s.findIndex((each) => each > endS - SPAN_S);
  const old = kept < 0 ? columns.time_s.length : kept;
  if (old) for (const name of ["time_s", ...SIGNALS.map(([each]) => each)]) columns[name].splice(0, old);
}

export function renderTraces(state) {
  const endS = Math.max(columns.time_s.at(-1) ?? 0, state.serverMs() / 1000 - 5);
  if (!fresh && endS - columns.endS < 1) return; // without new values the line moves out once a second
  fresh = false;
  columns.endS = endS;
  forget(endS);
  for (const [name, chart] of charts) chart.set([columns.time_s, columns[name]]);
}
