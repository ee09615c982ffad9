// Preload over minutes to years: line, interval, limits, events, and where it is going.

import { button, byId, element, fetchJson, refill, write } from "./dom.js";
import { Chart, axis, colour, spoken, timeAxis } from "./charts.js";

const SPANS = [["15 min", 900], ["8 h", 28800], ["7 days", 604800], ["90 days", 7776000], ["1 year", 31557600]];
const BUCKETS = 450;
const MARKED = ["condition_changed", "alarm_raised", "part_replaced", "note"];
const view = { span: 900, chart: null, state: null, loadedMs: -Infinity, key: "" };

function build(root) {
  const group = element("div", { class: "buttons", role: "group", "aria-label": "Span of the history" });
  for (const [name, span] of SPANS) {
    group.append(button(name, { "data-span": span, "aria-pressed": String(span === view.span) }, () => choose(span)));
  }
  view.holder = element("div", { class: "chart tall", id: "history-chart" });
  view.note = element("p", { class: "quiet" });
  view.download = element("p", { class: "quiet" });
  root.replaceChildren(element("div", { class: "panel-head" }, element("h2", { id: "past-title" }, "Preload so far, and where it goes"), group), view.holder, legend(), view.note, view.download);
  view.chart = new Chart(view.holder, options, describe);
}

function legend() {
  const key = (className, text) => element("span", { class: `key ${className}` }, text);
  return element("p", { class: "legend quiet" }, key("line", "preload, %"), key("band", "interval"), key("limit-warning", "warning limit"), key("limit-fault", "fault limit"), key("mark", "event"), key("future", "expected range"));
}

function choose(span) {
  view.span = span;
  view.loadedMs = -Infinity;
  for (const node of byId("past").querySelectorAll("[data-span]")) node.setAttribute("aria-pressed", String(Number(node.dataset.span) === span));
}

export async function renderHistory(state, nowMs) {
  if (view.chart === null) build(byId("past"));
  const period = Math.max(5000, Math.min(60000, (1000 * view.span) / BUCKETS));
  if (view.state === state && nowMs - view.loadedMs < period) return;
  view.state = state;
  view.loadedMs = nowMs;
  const end = state.serverMs() / 1000;
  const step = view.span / BUCKETS;
  const from = Math.floor((end - view.span) / step) * step;
  try {
    const { buckets } = await fetchJson(`/api/v1/axes/${state.axis}/history?from=${from}&to=${end}&step=${step}`);
    view.chart.set(columns(buckets, step));
  } catch {
    write(view.note, "The history cannot be reached now.");
    return;
  }
  write(view.note, `History is kept ${state.historyPlace}.`);
  refill(view.download, `${state.axis}${view.span}`, () => [
    "Download: ",
    ...["parquet", "arrow"].map((form) => element("a", { href: `/api/v1/axes/${state.axis}/history.${form}?from=${from}`, download: "" }, form)).flatMap((link, i) => (i ? [", ", link] : [link])),
  ]);
}

function columns(buckets, step) {
  const [x, high, low, mean] = [[], [], [], []];
  let last = null;
  for (const bucket of buckets) {
    const time = Date.parse(bucket.time) / 1000 + step / 2;
    if (last !== null && time - last > 2.5 * step) push(time - step, null, null, null);
    const spread = bucket.preload_percent;
    push(time, bucket.high ?? spread?.max ?? null, bucket.low ?? spread?.min ?? null, spread?.mean ?? null);
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

function describe([x, , , mean]) {
  return x.length ? `Preload of axis ${view.state.axis}: ${spoken(mean, "percent")}` : "No preload in this span";
}

function options(width) {
  const limits = view.state.limits;
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
  const fresh = view.state.limits?.fresh_percent ?? 0;
  const values = plot.data[3].filter((value) => value !== null);
  return [0, Math.max(fresh * 1.2, 1.2 * Math.max(0, ...values), 0.1)];
}

function timeRange() {
  const end = view.state.serverMs() / 1000;
  return [end - view.span, end + (futureOf() ? 0.35 : 0.02) * view.span];
}

function futureOf() {
  const { health, preload } = view.state;
  const last = health?.trend?.crossings.at(-1);
  if (!last?.earliest || preload?.preload_percent == null) return null;
  return { from: preload.preload_percent, to: last.limit_percent, early: Date.parse(last.earliest) / 1000, late: last.latest ? Date.parse(last.latest) / 1000 : Infinity };
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
  for (const [name, value, dash] of [["warning", limits.warning_percent, [8, 5]], ["fault", limits.fault_percent, [3, 4]]]) {
    ctx.strokeStyle = ctx.fillStyle = colour(name);
    ctx.lineWidth = 1.5 * devicePixelRatio;
    ctx.setLineDash(dash.map((part) => part * devicePixelRatio));
    line(ctx, [[left, y(value)], [left + width, y(value)]]);
    ctx.fillText(name, left + 4 * devicePixelRatio, y(value) - 4 * devicePixelRatio);
  }
  ctx.setLineDash([]);
}

function drawEvents(ctx, top, height, x) {
  ctx.lineWidth = devicePixelRatio;
  for (const event of view.state.events) {
    if (!MARKED.includes(event.kind)) continue;
    const at = x(Date.parse(event.time) / 1000);
    ctx.strokeStyle = ctx.fillStyle = event.kind === "part_replaced" || event.kind === "note" ? colour("accent") : event.severity === "error" ? colour("fault") : colour("quiet");
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
