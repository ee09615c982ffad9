// uPlot in the page's colours: values under the cursor or the arrow keys, and a sentence for those
// who cannot see it.

import { element } from "./dom.js";
import { clock, significant } from "./format.js";
import { locale, t } from "./strings.js";

const charts = new Set();
const STEPS = { ArrowLeft: -1, ArrowRight: 1, PageUp: -10, PageDown: 10, Home: -Infinity, End: Infinity };

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

export class Chart {
  // `options` makes the uPlot options for a width; it is asked again when colours or size change.
  // `read` says what stands at an index of the data; `zoom`, if given, takes the chosen [from, to].
  constructor(holder, options, describe, read, zoom = null) {
    Object.assign(this, { holder, options, describe, read, zoom, data: null, plot: null, at: null });
    this.values = element("p", { class: "chart-values quiet", "aria-live": "polite" });
    holder.after(this.values);
    holder.setAttribute("role", "img");
    holder.setAttribute("aria-label", t("chart.none"));
    holder.tabIndex = 0;
    holder.addEventListener("keydown", (event) => this.step(event));
    holder.addEventListener("blur", () => this.point(null));
    forgetRemoved();
    charts.add(this);
    new ResizeObserver(() => this.rebuild()).observe(holder);
  }

  set(data) {
    this.data = data;
    const text = this.describe(data);
    if (this.holder.getAttribute("aria-label") !== text) this.holder.setAttribute("aria-label", text);
    if (this.plot) this.plot.setData(data);
    else this.rebuild();
  }

  rebuild() {
    const width = this.holder.clientWidth;
    if (!this.data || width < 50) return;
    if (this.plot && this.plot.width === width && !this.recolour) return;
    this.recolour = false;
    this.plot?.destroy();
    const { hooks = {}, ...options } = this.options(width);
    const more = { ...hooks, setCursor: [(plot) => this.show(plot.cursor.idx)], setSelect: [(plot) => this.chosen(plot)] };
    this.plot = new uPlot({ legend: { show: false }, cursor: { y: false, drag: { x: this.zoom !== null, y: false, setScale: false } }, ...options, hooks: more }, this.data, this.holder);
  }

  // Keys go from value to value; empty ones are passed over.
  step(event) {
    if (!(event.key in STEPS) || event.shiftKey || !this.data?.[0].length) return;
    event.preventDefault();
    const last = this.data[0].length - 1;
    const isInside = (i) => this.data[0][i] >= this.plot.scales.x.min && this.data[0][i] <= this.plot.scales.x.max;
    const seen = [...this.data[0].keys()].filter((i) => isInside(i) && this.read(this.data, i) !== "");
    const now = this.at === null ? seen.length : seen.indexOf(seen.findLast((i) => i <= this.at));
    this.point(seen[Math.min(Math.max(now + STEPS[event.key], 0), seen.length - 1)] ?? last);
  }

  point(index) {
    this.at = index;
    if (!this.plot) return;
    const left = index === null ? -10 : this.plot.valToPos(this.data[0][index], "x");
    this.plot.setCursor({ left, top: 10 });
    this.show(index);
  }

  show(index) {
    const text = index == null || index >= this.data[0].length ? "" : this.read(this.data, index);
    if (this.values.textContent !== text) this.values.textContent = text;
  }

  chosen(plot) {
    const { left, width } = plot.select;
    if (this.zoom === null || width < 8) return;
    const ends = [plot.posToVal(left, "x"), plot.posToVal(left + width, "x")];
    plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.zoom(ends);
  }
}

// Charts whose panel was emptied; uPlot listens to the window until it is destroyed.
function forgetRemoved() {
  for (const chart of charts) {
    if (chart.holder.isConnected) continue;
    chart.plot?.destroy();
    charts.delete(chart);
  }
}

// What stands at an index: the place on the x axis, then each series that has a value there.
export function reader(placeOf, ...series) {
  return (data, i) => {
    const known = series.filter(([column]) => data[column][i] != null);
    return known.length ? t("chart.at", { place: placeOf(data[0][i]), values: known.map(([column, unit, name]) => `${name ? `${name} ` : ""}${significant(data[column][i], 4)} ${unit}`.trim()).join(", ") }) : "";
  };
}

export const atTime = (time) => clock(time * 1000);

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  for (const chart of charts) {
    chart.recolour = true;
    chart.rebuild();
  }
});

export function axis(more = {}) {
  const line = { stroke: colour("line"), width: 1 };
  const values = (self, splits) => splits.map((value) => value.toLocaleString(locale, { maximumSignificantDigits: 6 }));
  return { stroke: colour("quiet"), grid: line, ticks: line, font: "12px system-ui, sans-serif", space: 50, values, ...more };
}

export function timeAxis() {
  return axis({ values: timesAt, space: 80, size: 30 });
}

const FORMS = [
  [20 * 86400, { month: "short", year: "numeric" }],
  [86400, { day: "numeric", month: "numeric" }],
  [60, { hour: "2-digit", minute: "2-digit" }],
  [0, { hour: "2-digit", minute: "2-digit", second: "2-digit" }],
];

function timesAt(self, splits, index, space, step) {
  const form = new Intl.DateTimeFormat(locale, FORMS.find(([least]) => step >= least)[1]);
  return splits.map((time) => form.format(time * 1000));
}

// The last `span` seconds, so that one value does not stretch over years.
export function lately(span) {
  return { range: (self, first, last) => [(last ?? 0) - span, last ?? 1] };
}

export function range(least, most) {
  return (self, low, high) => {
    if (low === null) return [least ?? 0, most ?? 1];
    const margin = Math.max(0.08 * (high - low), 1e-9 + 0.02 * Math.abs(high));
    return [Math.min(low - margin, least ?? Infinity), Math.max(high + margin, most ?? -Infinity)];
  };
}

export function spoken(values, unit) {
  const known = values.filter((value) => value !== null && value !== undefined);
  if (known.length === 0) return t("chart.none");
  return t("chart.spoken", { last: significant(known.at(-1)), low: significant(Math.min(...known)), high: significant(Math.max(...known)), unit });
}
