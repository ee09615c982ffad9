// Preload over the last minutes: line, interval band, limits. A hole in the data is a hole in the plot.

import { svg } from "./dom.js";

export const SPAN_S = 900;
export const STEP_S = 5;
const WIDTH = 420;
const HEIGHT = 132;
const LEFT = 30;
const BOTTOM = 18;
const TOP = 6;
const RIGHT = 6;

export class History {
  constructor() {
    this.buckets = new Map();
  }

  load(buckets) {
    for (const bucket of buckets) {
      if (bucket.preload_percent === null) continue;
      const at = Math.floor(Date.parse(bucket.time) / 1000 / STEP_S);
      const { min, max, mean } = bucket.preload_percent;
      this.buckets.set(at, { value: mean, low: bucket.low ?? min, high: bucket.high ?? max, count: 1 });
    }
  }

  add(answer) {
    if (answer.preload_percent === null) return;
    const at = Math.floor(Date.parse(answer.measured_at) / 1000 / STEP_S);
    const low = answer.low ?? answer.preload_percent;
    const high = answer.high ?? answer.preload_percent;
    const old = this.buckets.get(at);
    if (old === undefined) {
      this.buckets.set(at, { value: answer.preload_percent, low, high, count: 1 });
    } else {
      old.count += 1;
      old.value += (answer.preload_percent - old.value) / old.count;
      old.low = Math.min(old.low, low);
      old.high = Math.max(old.high, high);
    }
  }

  runs(nowS) {
    const first = (nowS - SPAN_S) / STEP_S;
    for (const at of this.buckets.keys()) if (at < first) this.buckets.delete(at);
    const runs = [];
    let last = null;
    for (const at of [...this.buckets.keys()].sort((a, b) => a - b)) {
      if (last === null || at - last > 2) runs.push([]);
      runs.at(-1).push({ time: (at + 0.5) * STEP_S, ...this.buckets.get(at) });
      last = at;
    }
    return runs;
  }
}

export function draw(target, runs, limits, nowS) {
  const points = runs.flat();
  const top = niceTop(Math.max(1, limits ? limits.fresh_percent * 1.15 : 0, ...points.map((p) => p.high)));
  const x = (time) => LEFT + (1 - (nowS - time) / SPAN_S) * (WIDTH - LEFT - RIGHT);
  const y = (value) => TOP + (1 - Math.max(value, 0) / top) * (HEIGHT - TOP - BOTTOM);
  target.setAttribute("viewBox", `0 0 ${WIDTH} ${HEIGHT}`);
  target.replaceChildren(...axes(x, y, top, nowS), ...limitLines(limits, y), ...runs.flatMap((run) => curve(run, x, y)));
  if (points.length === 0) {
    target.append(svg("text", { x: (LEFT + WIDTH) / 2, y: HEIGHT / 2, class: "plot-empty" }, "no preload in the last 15 min"));
  }
}

function niceTop(value) {
  const step = value > 10 ? 5 : value > 4 ? 2 : 1;
  return Math.ceil(value / step) * step;
}

function axes(x, y, top, nowS) {
  const parts = [];
  for (const share of [0, 0.5, 1]) {
    const at = y(top * share);
    parts.push(svg("line", { x1: LEFT, x2: WIDTH - RIGHT, y1: at, y2: at, class: "grid" }));
    parts.push(svg("text", { x: LEFT - 5, y: at + 4, class: "tick end" }, String(+(top * share).toFixed(1))));
  }
  for (const minutes of [15, 10, 5, 0]) {
    const side = minutes === 0 ? "end" : minutes === 15 ? "start" : "middle";
    const label = minutes === 0 ? "now" : `−${minutes} min`;
    parts.push(svg("text", { x: x(nowS - minutes * 60), y: HEIGHT - 4, class: `tick ${side}` }, label));
  }
  return parts;
}

function limitLines(limits, y) {
  if (!limits) return [];
  return [["warning", limits.warning_percent], ["fault", limits.fault_percent]].map(([name, value]) =>
    svg("line", { x1: LEFT, x2: WIDTH - RIGHT, y1: y(value), y2: y(value), class: `limit ${name}` }),
  );
}

function curve(run, x, y) {
  const at = (point, key) => `${x(point.time).toFixed(1)},${y(point[key]).toFixed(1)}`;
  const upper = run.map((point) => at(point, "high"));
  const lower = run.map((point) => at(point, "low")).reverse();
  const line = run.map((point) => at(point, "value"));
  if (run.length === 1) line.push(line[0]);
  return [
    svg("polygon", { points: [...upper, ...lower].join(" "), class: "band" }),
    svg("polyline", { points: line.join(" "), class: "line" }),
  ];
}
