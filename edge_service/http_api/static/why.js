// Why: what the estimator believes, friction, model, temperature, and the state of the data.

import { byId, element, fetchJson, list, refill, write } from "./dom.js";
import { Chart, atTime, axis, colour, lately, range, reader, spoken, timeAxis } from "./charts.js";
import { clock, number, ofFresh, significant } from "./format.js";
import { isActive } from "./level.js";
import { named, t } from "./strings.js";

const SYMBOLS = { ok: "✓", faulty: "△", missing: "✕" };
const R_MIN_PER_RAD_S = 30 / Math.PI;
const HISTORY_S = 3600;
const CHANGES = ["preload_loss", "lubrication", "payload", "looseness", "process_force"];
const FITS_BELOW = 4; // times the squared error that the estimator expects of itself
const LEAST_NM = 0.001; // the last digit shown
let parts = {};

function build() {
  parts = {};
  parts.modes = element("ul", { class: "modes" });
  parts.believed = element("p", { class: "quiet" });
  parts.second = element("p", { class: "quiet", id: "second" });
  parts.secondModes = element("ul", { class: "modes", "aria-label": t("second.modes") });
  parts.changes = element("div", {});
  byId("belief").replaceChildren(
    element("h2", { id: "belief-title" }, t("belief")),
    parts.believed,
    parts.modes,
    parts.second,
    parts.secondModes,
    parts.changes,
  );
  parts.frictionText = element("p", { class: "quiet" });
  const friction = element("div", { class: "chart" });
  byId("friction").replaceChildren(
    element("h2", { id: "friction-title" }, t("friction")),
    friction,
    element("p", { class: "legend quiet" }, element("span", { class: "key line" }, t("legend.now")), element("span", { class: "key first" }, t("legend.new"))),
    parts.frictionText,
  );
  parts.friction = new Chart(friction, frictionOptions, ([, now]) => `${t("friction.label")}: ${spoken(now, t("unit.nm"))}`, reader((speed) => `${number(speed)} ${t("unit.r_min")}`, [1, t("unit.nm")], [2, t("unit.nm"), t("legend.new")]));
  parts.modelText = element("p", {});
  parts.modelParts = element("ul", { class: "quiet" });
  parts.warm = element("p", {});
  parts.stiffness = element("p", { class: "quiet" });
  const nis = element("div", { class: "chart" });
  const temperature = element("div", { class: "chart" });
  byId("model").replaceChildren(
    element("h2", { id: "model-title" }, t("model")),
    parts.modelText,
    parts.modelParts,
    nis,
    element("h3", {}, t("warm")),
    parts.warm,
    temperature,
    element("h3", {}, t("stiffness")),
    parts.stiffness,
  );
  parts.nis = new Chart(nis, (width) => lineOptions(width, 0, 3), ([, values]) => `${t("model.label")}: ${spoken(values, "")}`, reader(atTime, [1, ""]));
  parts.temperature = new Chart(temperature, (width) => lineOptions(width), ([, values]) => `${t("warm.label")}: ${spoken(values, "°C")}`, reader(atTime, [1, "°C"]));
  parts.channels = element("tbody", {});
  parts.faults = element("p", {});
  byId("quality").replaceChildren(
    element("h2", { id: "quality-title" }, t("quality")),
    element("table", {}, element("thead", {}, element("tr", {}, ...[t("quality.channel"), t("quality.now"), t("quality.share")].map((text) => element("th", { scope: "col" }, text)))), parts.channels),
    element("h3", {}, t("quality.faults")),
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
  if (!byId("belief").firstChild) build();
  const { method } = (state.connected && state.preload) || {};
  write(parts.believed, `${t("belief.text")}${method ? ` ${t("belief.method", { method })}` : ""}`);
  renderModes(parts.modes, state, (state.connected && state.preload?.mode_probability) || {}, [t("belief.none")]);
  renderModel(state);
  renderChanges((state.connected && state.preload?.fault_probability) || {});
  const faults = Object.entries(state.health?.data_faults ?? {}).map(([kind, n]) => `${named("fault", kind)}: ${number(n)}`);
  write(parts.faults, faults.length ? faults.join(", ") : t("quality.no_faults"));
}

function renderModes(list, state, probabilities, none) {
  const levels = Object.keys(probabilities).sort((a, b) => b - a);
  refill(list, JSON.stringify(levels.map((level) => [level, probabilities[level].toFixed(2)])), () =>
    levels.length === 0
      ? none.map((words) => element("li", {}, words))
      : levels.map((level) => {
          const share = probabilities[level];
          const bar = element("progress", { max: 1, value: share, "aria-label": t("belief.level", { level: levelWords(state, level) }) });
          return element("li", { class: "mode" }, element("span", {}, levelWords(state, level)), bar, element("span", {}, chance(share)));
        }),
  );
}

const chance = (share) => t("percent", { n: number(100 * share) });
const levelWords = ({ limits }, level) => (limits ? t("percent", { n: number(ofFresh(Number(level), limits)) }) : t("percent", { n: number(Number(level), 1) }));

function renderChanges(probabilities) {
  const known = CHANGES.filter((name) => name in probabilities);
  refill(parts.changes, JSON.stringify(known.map((name) => [name, probabilities[name].toFixed(2)])), () =>
    known.length === 0
      ? []
      : [
          element("h3", {}, t("changes")),
          element("ul", { class: "modes" }, ...known.map((name) => {
            const share = probabilities[name];
            const bar = element("progress", { max: 1, value: share, "aria-label": t(`change.${name}`) });
            return element("li", { class: "mode change" }, element("span", {}, t(`change.${name}`)), bar, element("span", {}, chance(share)));
          })),
        ],
  );
}

// Slower things, asked for every few seconds.
export async function loadWhy(state) {
  if (!byId("belief").firstChild) build();
  const asking = parts;
  const path = `/api/v1/axes/${encodeURIComponent(state.axis)}`;
  const end = state.serverMs() / 1000;
  const [{ friction }, second, live, history] = await Promise.all([
    fetchJson(`${path}/wear`),
    fetchJson(`${path}/imm`),
    fetchJson(`${path}/live?duration=1`),
    fetchJson(`${path}/history?from=${end - HISTORY_S}&to=${end}&step=20`),
  ]);
  if (asking !== parts) return; // another axis is shown by now
  parts.friction.set([friction.speed_rad_s.map((speed) => speed * R_MIN_PER_RAD_S), friction.torque_nm, friction.first_torque_nm]);
  write(parts.frictionText, frictionText(friction));
  write(parts.second, secondText(state, second));
  renderModes(parts.secondModes, state, second.mode_probability, []);
  renderChannels(live.channels);
  const times = history.buckets.map((bucket) => Date.parse(bucket.time) / 1000 + 10);
  const column = (name) => history.buckets.map((bucket) => bucket[name]?.mean ?? null);
  parts.nis.set([times, column("nis")]);
  parts.temperature.set([times, column("temperature_c")]);
  parts.error = recentMean(column("nis"));
  renderModel(state);
  write(parts.warm, warmText(times, column("temperature_c")));
  write(parts.stiffness, stiffnessText(state.connected ? state.preload?.stiffness_n_per_m : null));
}

function secondText({ limits, preload }, { preload_percent: percent, low, high }) {
  if (percent === null) return t("second.none");
  const [value, from, to] = [percent, low, high].map((each) => (limits ? number(ofFresh(each, limits)) : number(each, 1)));
  const parted = preload && preload.preload_percent !== null && (preload.low > high || low > preload.high);
  return `${t("second", { value, from, to })}${parted ? ` ${t("second.parted")}` : ""}`;
}

function frictionText({ torque_nm: now, first_torque_nm: first, count }) {
  const weight = count.reduce((sum, n, i) => (now[i] === first[i] ? sum : sum + n), 0); // equal: nothing is newer than the first
  if (weight === 0) return now.length === 0 ? t("friction.none") : "";
  const change = now.reduce((sum, torque, i) => sum + count[i] * (Math.abs(torque) - Math.abs(first[i])), 0) / weight;
  if (Math.abs(change) < LEAST_NM) return t("friction.same");
  return t(change < 0 ? "friction.lower" : "friction.higher", { n: number(Math.abs(change), 3) });
}

function stiffnessText(stiffness) {
  if (!stiffness) return t("stiffness.none");
  const micro = (bound) => number(stiffness[bound] / 1e6, 1);
  return t("stiffness.value", { value: micro("value"), low: micro("low"), high: micro("high") });
}

function recentMean(values) {
  const recent = values.filter((value) => value !== null).slice(-6);
  return recent.length ? recent.reduce((a, b) => a + b, 0) / recent.length : null;
}

// Two quantities: the estimator's error, and the axis against what was learned of it.
function renderModel(state) {
  const { consistency } = state.health ?? {};
  const learned = consistency?.state ?? "none";
  const { channel, ratio, since } = consistency ?? {};
  const error = parts.error ?? null;
  const details = learned === "disagrees" ? { channel: named("watched", channel), n: significant(ratio[channel], 2), since: clock(since) } : {};
  write(parts.modelText, t(`model.${fit(state, learned, error)}`));
  const texts = [error === null ? t("model.error.none") : t("model.error", { n: significant(error, 2) }), t(`model.learned.${learned}`, details)];
  if (isActive(state, "model")) texts.push(t("model.alarm"));
  list(parts.modelParts, texts.map((text) => ({ text })));
}

function fit(state, learned, error) {
  if (state.preload?.status === "invalid" || learned === "disagrees" || isActive(state, "model")) return "no";
  if (error === null) return "unknown";
  return error < FITS_BELOW ? "yes" : "doubtful";
}

function warmText(times, values) {
  const known = times.map((time, i) => [time, values[i]]).filter(([, value]) => value !== null);
  if (known.length === 0) return t("warm.none");
  const recent = known.filter(([time]) => time > known.at(-1)[0] - 900);
  const change = recent.at(-1)[1] - recent[0][1];
  const now = number(recent.at(-1)[1], 1);
  if (recent.length < 6) return t("warm.early", { now });
  if (Math.abs(change) < 0.5) return t("warm.settled", { now });
  const minutes = Math.round((recent.at(-1)[0] - recent[0][0]) / 60);
  return t(change > 0 ? "warm.up" : "warm.down", { now, change: number(Math.abs(change), 1), minutes });
}

function renderChannels(channels) {
  refill(parts.channels, JSON.stringify(channels), () =>
    channels.length === 0
      ? [element("tr", {}, element("td", { colspan: 3 }, t("quality.nothing")))]
      : channels.map(({ channel, state, good_share: share }) => element("tr", { "data-state": state }, element("th", { scope: "row" }, named("channel", channel)), element("td", {}, `${SYMBOLS[state]} ${named("channel", state)}`), element("td", {}, t("percent", { n: number(100 * share) })))),
  );
}
