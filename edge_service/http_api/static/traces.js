// What the axis does right now: the last minute of four signals.

import { byId, element, fetchJson } from "./dom.js";
import { Chart, axis, colour, range, spoken, timeAxis } from "./charts.js";

const SPAN_S = 60;
const HOLE_S = 1;
const SIGNALS = [
  ["torque_nm", "Torque", "N m", 0.1],
  ["speed_rad_s", "Motor speed", "rad/s", 1],
  ["position_m", "Position", "m", 0.001],
  ["transmission_um", "Transmission difference (zero has no meaning)", "µm", 0.2],
];
const charts = new Map();
const columns = { axis: null, time_s: [] };
let fresh = false;

function build(root) {
  const grid = element("div", { class: "small-charts four" });
  for (const [name, title, unit, least] of SIGNALS) {
    const holder = element("div", { class: "chart", id: `trace-${name}` });
    grid.append(element("div", {}, element("h3", {}, `${title}, ${unit}`), holder));
    charts.set(name, new Chart(holder, (width) => options(width, least), ([, values]) => `${title}, last minute: ${spoken(values, unit)}`));
  }
  root.replaceChildren(element("h2", { id: "traces-title" }, "Right now"), grid);
}

function options(width, least) {
  return {
    width,
    height: 130,
    scales: { x: { range: () => [columns.endS - SPAN_S, columns.endS] }, y: { range: (self, low, high) => range(low === null ? 0 : Math.min(low, high - least), null)(self, low, high) } },
    axes: [timeAxis(), axis({ size: 50, space: 24 })],
    series: [{}, { stroke: colour("accent"), width: 1.5, points: { show: false }, spanGaps: false }],
  };
}

export async function startTraces(state) {
  if (charts.size === 0) build(byId("traces"));
  columns.axis = state.axis;
  columns.time_s = [];
  const answer = await fetchJson(`/api/v1/axes/${state.axis}/traces?seconds=${SPAN_S}`).catch(() => null);
  if (answer === null || columns.axis !== answer.axis) return;
  columns.time_s = [];
  for (const [name] of SIGNALS) columns[name] = [];
  answer.time_s.forEach((time, i) => add(time, (name) => answer[name][i]));
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
  for (const [name] of SIGNALS) columns[name].push(valueOf(name));
}

export function takeLive(answer) {
  if (answer.axis !== columns.axis || columns.torque_nm === undefined) return;
  const time = Date.parse(answer.time) / 1000;
  const last = columns.time_s.at(-1) ?? -Infinity;
  if (time <= last) return;
  add(time, (name) => answer[name]);
  const old = columns.time_s.findIndex((each) => each > time - SPAN_S - 2);
  if (old > 50) for (const name of ["time_s", ...SIGNALS.map(([each]) => each)]) columns[name].splice(0, old);
  fresh = true;
}

export function renderTraces(state) {
  if (!fresh && state.connected) return;
  fresh = false;
  columns.endS = Math.max(columns.time_s.at(-1) ?? 0, state.serverMs() / 1000 - 5);
  if (columns.torque_nm === undefined) return;
  for (const [name, chart] of charts) chart.set([columns.time_s, columns[name]]);
}
