// Preload over minutes to years: line, interval, limits, events, and where it is going.

import { button, byId, element, fetchJson, refill, write } from "./dom.js";
import { Chart, atTime, axis, colour, reader, spoken, timeAxis } from "./charts.js";
import { ofFresh } from "./format.js";
import { counted, t } from "./strings.js";

const MINUTE_S = 60;
const DAY_S = 86400;
const DEFAULT_DAYS = 30;
const SPANS = [["min", 15, 15 * MINUTE_S], ["h", 8, 8 * 3600], ["days", 7, 7 * DAY_S], ["days", DEFAULT_DAYS, DEFAULT_DAYS * DAY_S], ["days", 90, 90 * DAY_S], ["years", 1, 365.25 * DAY_S]];
const BUCKETS = 450;
const LEAST_SPAN_S = 10;
const MARKED = ["condition_changed", "alarm_raised", "part_replaced", "note"];
const FORMS = ["csv", "parquet"];
// `end` is null while the newest is followed.
const view = { span: null, end: null, chart: null, state: null, loadedMs: -Infinity, asked: 0 };

function build(root) {
  view.spans = element("div", { class: "buttons", role: "group", "aria-label": t("history.span") });
  for (const [unit, n, span] of SPANS) view.spans.append(button(counted(`span.${unit}`, n), { "data-span": span, "aria-pressed": "false" }, () => choose(span, null)));
  view.holder = element("div", { class: "chart tall", id: "history-chart" });
  view.note = element("p", { class: "quiet" });
  view.download = element("p", { class: "quiet" });
  root.replaceChildren(element("div", { class: "panel-head" }, element("h2", { id: "past-title" }, t("history")), view.spans), rangeForm(), element("div", {}, view.holder), legend(), view.note, view.download);
  view.loadedMs = -Infinity;
  view.chart = new Chart(view.holder, options, describe, reader(atTime, [3, t("unit.fresh")], [2, "", t("history.low")], [1, "", t("history.high")]), ([from, to]) => choose(Math.max(to - from, LEAST_SPAN_S), to));
  view.holder.addEventListener("keydown", zoomByKey);
  press();
}

function rangeForm() {
  const field = (name) => (view[name] = element("input", { type: "datetime-local", id: `history-${name}`, required: "" }));
  const form = element("form", { class: "range" }, element("label", { for: "history-from" }, t("history.from"), field("from")), element("label", { for: "history-to" }, t("history.to"), field("to")), element("button", { type: "submit" }, t("history.show")), element("span", { class: "quiet" }, t("history.zoom")));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    const [from, to] = [view.from, view.to].map((node) => Date.parse(node.value) / 1000);
    if (from < to) choose(to - from, to);
    else write(view.note, t("history.backwards"));
  });
  return form;
}

function legend() {
  const key = (name) => element("span", { class: `key ${name}` }, t(`history.key.${name}`));
  return element("p", { class: "legend quiet" }, ...["line", "band", "limit-warning", "limit-fault", "mark", "future"].map(key));
}

function choose(span, end) {
  Object.assign(view, { span, end, loadedMs: -Infinity });
  press();
}

function press() {
  for (const node of view.spans.children) node.setAttribute("aria-pressed", String(view.end === null && Number(node.dataset.span) === view.span));
}

// + and - zoom, the arrows with shift move the window.
function zoomByKey(event) {
  if (view.span === null) return;
  const [first, last] = ends();
  const middle = (first + last) / 2;
  const windows = { "+": [middle, 0.25], "-": [middle, 1], ArrowLeft: [middle - view.span / 4, 0.5], ArrowRight: [middle + view.span / 4, 0.5] };
  if (!(event.key in windows) || (event.key.startsWith("Arrow") && !event.shiftKey)) return;
  event.preventDefault();
  const [at, half] = windows[event.key];
  choose(Math.max(2 * half * view.span, LEAST_SPAN_S), at + half * view.span);
}

function ends() {
  const end = view.end ?? view.state.serverMs() / 1000;
  return [end - view.span, end];
}

// The shortest span that shows all there is, and at most 30 days of it.
async function chooseFirst(state) {
  const end = state.serverMs() / 1000;
  const { buckets } = await fetchJson(`${pathOf(state)}?from=${end - DEFAULT_DAYS * DAY_S}&to=${end}&step=${DAY_S / 4}`);
  const age = buckets.length ? end - Date.parse(buckets[0].time) / 1000 - DAY_S / 4 : 0;
  choose(SPANS.find(([, , span]) => span >= Math.min(age, DEFAULT_DAYS * DAY_S))[2], null);
}

const pathOf = (state) => `/api/v1/axes/${encodeURIComponent(state.axis)}/history`;

export async function renderHistory(state, nowMs) {
  view.state = state;
  if (!byId("past").firstChild) build(byId("past"));
  const period = Math.max(5000, Math.min(60000, (1000 * (view.span ?? 0)) / BUCKETS));
  if (!state.connected || nowMs - view.loadedMs < period) return;
  view.loadedMs = nowMs;
  try {
    if (view.span === null) await chooseFirst(state);
    view.loadedMs = nowMs;
    await load(state);
  } catch {
    write(view.note, t("history.unreachable"));
  }
}

async function load(state) {
  const [first, end] = ends();
  const step = view.span / BUCKETS;
  const from = Math.floor(first / step) * step;
  const turn = ++view.asked;
  const { buckets } = await fetchJson(`${pathOf(state)}?from=${from}&to=${end}&step=${step}`);
  if (turn !== view.asked || view.state !== state) return; // another window or axis is shown by now
  view.chart.set(columns(buckets, step));
  [view.from.value, view.to.value] = document.activeElement?.closest(".range") ? [view.from.value, view.to.value] : [first, end].map(local);
  write(view.note, buckets.length ? "" : t("history.empty"));
  const links = () => FORMS.map((form) => element("a", { href: `${pathOf(state)}?format=${form}&from=${from}${view.end === null ? "" : `&to=${end}`}`, download: "" }, form.toUpperCase()));
  refill(view.download, `${state.axis} ${view.span} ${view.end}`, () => [t("history.download"), " ", ...links().flatMap((link, i) => (i ? [", ", link] : [link]))]);
}

// UNIX s as a datetime-local field writes it.
const local = (time) => new Date((time - new Date(time * 1000).getTimezoneOffset() * 60) * 1000).toISOString().slice(0, 16);

function columns(buckets, step) {
  const [x, high, low, mean] = [[], [], [], []];
  let last = null;
  for (const bucket of buckets) {
    const time = Date.parse(bucket.time) / 1000 + step / 2;
    if (last !== null && time - last > 2.5 * step) push(time - step, null, null, null);
    const spread = bucket.preload_percent;
    push(time, ...[bucket.high ?? spread?.max, bucket.low ?? spread?.min, spread?.mean].map(shown));
    last = time;
  }
  return [x, high, low, mean];

  function push(time, top, bottom, value) {
    x.push(time);
    high.push(top);
    low.push(bottom);
    mean.push(value);
  }
}

// Percent of the fresh screw; of the load rating where the fresh preload is not known.
function shown(value) {
  const { limits } = view.state;
  return value == null ? null : limits ? ofFresh(value, limits) : value;
}

function describe([x, , , mean]) {
  return x.length ? `${t("history.label", { axis: view.state.axis })}: ${spoken(mean, "%")}` : t("history.empty");
}

function options(width) {
  return {
    width,
    height: 260,
    scales: { x: { range: timeRange }, y: { range: valueRange } },
    axes: [timeAxis(), axis({ size: 44 })],
    series: [
      {},
      { stroke: "transparent", points: { show: false } },
      { stroke: "transparent", points: { show: false } },
      { stroke: colour("accent"), width: 2, points: { show: false } },
    ],
    bands: [{ series: [1, 2], fill: `${colour("accent")}38` }],
    hooks: { draw: [draw] },
  };
}

// The line decides, not its interval: that may be very wide at first.
function valueRange(plot) {
  const fresh = view.state.limits ? 100 : 0;
  const values = plot.data[3].filter((value) => value !== null);
  return [0, Math.max(fresh * 1.2, 1.2 * Math.max(0, ...values), 0.1)];
}

function timeRange() {
  const [first, end] = ends();
  return [first, view.end === null ? end + (futureOf() ? 0.35 : 0.02) * view.span : end];
}

function futureOf() {
  const { health, preload } = view.state;
  const last = health?.trend?.crossings.at(-1);
  if (!last?.earliest || preload?.preload_percent == null) return null;
  return { from: shown(preload.preload_percent), to: shown(last.limit_percent), early: Date.parse(last.earliest) / 1000, late: last.latest ? Date.parse(last.latest) / 1000 : Infinity };
}

function draw(plot) {
  const { ctx } = plot;
  const { left, top, width, height } = plot.bbox;
  ctx.save();
  ctx.beginPath();
  ctx.rect(left, top, width, height);
  ctx.clip();
  ctx.textAlign = "left";
  ctx.textBaseline = "bottom";
  ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
  const x = (time) => plot.valToPos(time, "x", true);
  const y = (value) => plot.valToPos(value, "y", true);
  drawLimits(ctx, left, width, y);
  drawEvents(ctx, top, height, x);
  drawFuture(ctx, x, y, left + width);
  ctx.restore();
}

function drawLimits(ctx, left, width, y) {
  const limits = view.state.limits;
  if (!limits) return;
  for (const [name, value, dash] of [["warning", shown(limits.warning_percent), [8, 5]], ["fault", shown(limits.fault_percent), [3, 4]]]) {
    ctx.strokeStyle = ctx.fillStyle = colour(name);
    ctx.lineWidth = 1.5 * devicePixelRatio;
    ctx.setLineDash(dash.map((part) => part * devicePixelRatio));
    line(ctx, [[left, y(value)], [left + width, y(value)]]);
    ctx.fillText(t(`gauge.${name}`), left + 4 * devicePixelRatio, y(value) - 4 * devicePixelRatio);
  }
  ctx.setLineDash([]);
}

function drawEvents(ctx, top, height, x) {
  ctx.lineWidth = devicePixelRatio;
  for (const event of view.state.events) {
    if (!MARKED.includes(event.kind)) continue;
    const at = x(Date.parse(event.at) / 1000);
    ctx.strokeStyle = ctx.fillStyle = event.kind === "part_replaced" || event.kind === "note" ? colour("accent") : event.level === "FAULT" ? colour("fault") : colour("quiet");
    ctx.globalAlpha = 0.7;
    line(ctx, [[at, top + 6 * devicePixelRatio], [at, top + height]]);
    ctx.globalAlpha = 1;
    const size = 5 * devicePixelRatio;
    ctx.beginPath();
    ctx.moveTo(at - size, top);
    ctx.lineTo(at + size, top);
    ctx.lineTo(at, top + 1.6 * size);
    ctx.fill();
  }
}

function drawFuture(ctx, x, y, right) {
  const future = futureOf();
  if (!future) return;
  const now = view.state.serverMs() / 1000;
  const far = Number.isFinite(future.late) ? [x(future.late), y(future.to)] : [right, y(future.from)];
  ctx.fillStyle = `${colour("warning")}30`;
  ctx.strokeStyle = colour("warning");
  ctx.setLineDash([4 * devicePixelRatio, 4 * devicePixelRatio]);
  line(ctx, [[x(future.early), y(future.to)], [x(now), y(future.from)], far]);
  ctx.fill();
  ctx.setLineDash([]);
}

function line(ctx, points) {
  ctx.beginPath();
  points.forEach(([px, py], i) => (i ? ctx.lineTo(px, py) : ctx.moveTo(px, py)));
  ctx.stroke();
}
