// Why: what the estimator believes, friction, model, temperature, and the state of the data.

import { byId, element, fetchJson, refill, write } from "./dom.js";
import { Chart, axis, colour, lately, range, spoken, timeAxis } from "./charts.js";

const SYMBOLS = { ok: "✓ ok", faulty: "△ faulty at times", missing: "✕ missing" };
const HISTORY_S = 3600;
const CHANGES = {
  preload_loss: "Preload lost, more than 10 %",
  lubrication: "More friction at the same preload (lubrication)",
  payload: "Another load on the table",
  looseness: "Coupling, bearings or screw yield more",
  process_force: "A process pushes the table now",
};
const parts = {};

function build() {
  parts.modes = element("ul", { class: "modes" });
  parts.changes = element("div", {});
  byId("belief").replaceChildren(
    element("h2", { id: "belief-title" }, "What the estimator believes"),
    element("p", { class: "quiet" }, "Probability of each level of preload, percent of the load rating."),
    parts.modes,
    parts.changes,
  );
  parts.frictionText = element("p", { class: "quiet" });
  const friction = element("div", { class: "chart" });
  byId("friction").replaceChildren(
    element("h2", { id: "friction-title" }, "Friction curve, N m over rad/s"),
    friction,
    element("p", { class: "legend quiet" }, element("span", { class: "key line" }, "now"), element("span", { class: "key first" }, "when the part was new")),
    parts.frictionText,
  );
  parts.friction = new Chart(friction, frictionOptions, ([, now]) => `Torque at steady speed: ${spoken(now, "newton metres")}`);
  parts.modelText = element("p", {});
  parts.warm = element("p", {});
  parts.stiffness = element("p", { class: "quiet" });
  const nis = element("div", { class: "chart" });
  const temperature = element("div", { class: "chart" });
  byId("model").replaceChildren(
    element("h2", { id: "model-title" }, "Does the model fit?"),
    parts.modelText,
    nis,
    element("h3", {}, "Warm-up: temperature, °C"),
    parts.warm,
    temperature,
    element("h3", {}, "Stiffness"),
    parts.stiffness,
  );
  parts.nis = new Chart(nis, (width) => lineOptions(width, 0, 3), ([, values]) => `Squared error of the model, 1 if it fits: ${spoken(values, "")}`);
  parts.temperature = new Chart(temperature, (width) => lineOptions(width), ([, values]) => `Temperature: ${spoken(values, "degrees")}`);
  parts.channels = element("tbody", {});
  parts.faults = element("p", {});
  byId("quality").replaceChildren(
    element("h2", { id: "quality-title" }, "Quality of the data"),
    element("table", {}, element("thead", {}, element("tr", {}, ...["Channel", "Now", "Good, last minute"].map((text) => element("th", { scope: "col" }, text)))), parts.channels),
    element("h3", {}, "Faulty intervals since the start"),
    parts.faults,
  );
}

function lineOptions(width, least, most) {
  return {
    width,
    height: 120,
    scales: { x: lately(HISTORY_S), y: { range: range(least, most) } },
    axes: [timeAxis(), axis({ size: 44, space: 24 })],
    series: [{}, { stroke: colour("accent"), width: 1.5, points: { show: false } }],
  };
}

function frictionOptions(width) {
  const points = { show: true, size: 6 };
  return {
    width,
    height: 200,
    scales: { x: { time: false }, y: { range: range() } },
    axes: [axis({ size: 30 }), axis({ size: 50, space: 28 })],
    series: [{}, { stroke: colour("accent"), width: 2, points }, { stroke: colour("quiet"), width: 1.5, dash: [5, 4], points }],
  };
}

export function renderWhy(state) {
  if (!parts.modes) build();
  const probabilities = (state.connected && state.preload?.mode_probability) || {};
  const levels = Object.keys(probabilities).sort((a, b) => b - a);
  refill(parts.modes, JSON.stringify(levels.map((level) => [level, probabilities[level].toFixed(2)])), () =>
    levels.length === 0
      ? [element("li", {}, "nothing: there is no estimate now")]
      : levels.map((level) => {
          const share = probabilities[level];
          const bar = element("progress", { max: 1, value: share, "aria-label": `level ${level} percent` });
          return element("li", { class: "mode" }, element("span", {}, `${level} %`), bar, element("span", {}, share.toFixed(2)));
        }),
  );
  renderChanges((state.connected && state.preload?.fault_probability) || {});
  const faults = Object.entries(state.health?.data_faults ?? {}).map(([kind, n]) => `${kind.replaceAll("_", " ")}: ${n}`);
  write(parts.faults, faults.length ? faults.join(", ") : "none");
}

function renderChanges(probabilities) {
  const known = Object.keys(CHANGES).filter((name) => name in probabilities);
  refill(parts.changes, JSON.stringify(known.map((name) => [name, probabilities[name].toFixed(2)])), () =>
    known.length === 0
      ? []
      : [
          element("h3", {}, "What has changed since commissioning, and how probable that is"),
          element("ul", { class: "modes" }, ...known.map((name) => {
            const share = probabilities[name];
            const bar = element("progress", { max: 1, value: share, "aria-label": CHANGES[name] });
            return element("li", { class: "mode change" }, element("span", {}, CHANGES[name]), bar, element("span", {}, share.toFixed(2)));
          })),
        ],
  );
}

// Slower things, asked for every few seconds.
export async function loadWhy(state) {
  if (!parts.modes) build();
  const path = `/api/v1/axes/${state.axis}`;
  const end = state.serverMs() / 1000;
  const [friction, traces, history] = await Promise.all([
    fetchJson(`${path}/friction`),
    fetchJson(`${path}/traces?seconds=1`),
    fetchJson(`${path}/history?from=${end - HISTORY_S}&to=${end}&step=20`),
  ]);
  parts.friction.set([friction.speed_rad_s, friction.torque_nm, friction.first_torque_nm]);
  write(parts.frictionText, frictionText(friction));
  renderChannels(traces.channels);
  const times = history.buckets.map((bucket) => Date.parse(bucket.time) / 1000 + 10);
  const column = (name) => history.buckets.map((bucket) => bucket[name]?.mean ?? null);
  parts.nis.set([times, column("nis")]);
  parts.temperature.set([times, column("temperature_c")]);
  write(parts.modelText, modelText(state, column("nis")));
  write(parts.warm, warmText(times, column("temperature_c")));
  write(parts.stiffness, stiffnessText(state.connected ? state.preload?.stiffness_n_per_m : null));
}

function frictionText({ torque_nm: now, first_torque_nm: first, count }) {
  if (now.length === 0) return "No motion at steady speed yet.";
  const weight = count.reduce((a, b) => a + b, 0);
  const change = now.reduce((sum, torque, i) => sum + count[i] * (Math.abs(torque) - Math.abs(first[i])), 0) / weight;
  return `On average ${Math.abs(change).toFixed(3)} N m ${change < 0 ? "lower" : "higher"} than when the part was new.`;
}

function stiffnessText(stiffness) {
  if (!stiffness) return "This estimator does not measure it from ordinary work; a fingerprint test does (below).";
  const micro = (bound) => (stiffness[bound] / 1e6).toFixed(1);
  return `${micro("value")} N/µm between motor and table (95 % sure: ${micro("low")} to ${micro("high")}).`;
}

function modelText(state, values) {
  const known = values.filter((value) => value !== null);
  if (state.preload?.status === "invalid") return "No: model and data disagree.";
  if (known.length === 0) return "Not known: there is no estimate in the last hour.";
  const last = known.slice(-6).reduce((a, b) => a + b, 0) / Math.min(known.length, 6);
  return last < 4 ? `Yes: its squared error is ${Number(last.toPrecision(2))} times as expected (1 if it fits).` : `Doubtful: its squared error is ${Number(last.toPrecision(2))} times as expected.`;
}

function warmText(times, values) {
  const known = times.map((time, i) => [time, values[i]]).filter(([, value]) => value !== null);
  if (known.length === 0) return "No temperature is measured, so a warm-up cannot be told.";
  const recent = known.filter(([time]) => time > known.at(-1)[0] - 900);
  const change = recent.at(-1)[1] - recent[0][1];
  const now = recent.at(-1)[1].toFixed(1);
  if (recent.length < 6) return `${now} °C; too early to tell whether it warms up.`;
  return Math.abs(change) < 0.5 ? `Settled at ${now} °C.` : `${change > 0 ? "Warming up" : "Cooling down"}: ${now} °C, ${Math.abs(change).toFixed(1)} degrees in ${Math.round((recent.at(-1)[0] - recent[0][0]) / 60)} min.`;
}

function renderChannels(channels) {
  refill(parts.channels, JSON.stringify(channels), () =>
    channels.length === 0
      ? [element("tr", {}, element("td", { colspan: 3 }, "nothing heard yet"))]
      : channels.map(({ channel, state, good_share: share }) => element("tr", { "data-state": state }, element("th", { scope: "row" }, channel), element("td", {}, SYMBOLS[state]), element("td", {}, `${(100 * share).toFixed(0)} %`))),
  );
}
