// uPlot in the page's colours, with a sentence for those who cannot see it.

const charts = new Set();

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

export class Chart {
  // `options` makes the uPlot options for a width; it is asked again when colours or size change.
  constructor(holder, options, describe) {
    this.holder = holder;
    this.options = options;
    this.describe = describe;
    this.data = null;
    this.plot = null;
    holder.setAttribute("role", "img");
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
    this.plot = new uPlot({ legend: { show: false }, cursor: { drag: { x: false, y: false } }, ...this.options(width) }, this.data, this.holder);
  }
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
  for (const chart of charts) {
    chart.recolour = true;
    chart.rebuild();
  }
});

export function axis(more = {}) {
  const line = { stroke: colour("line"), width: 1 };
  return { stroke: colour("quiet"), grid: line, ticks: line, font: "12px system-ui, sans-serif", space: 50, ...more };
}

export function timeAxis() {
  return axis({ values: uTimes, space: 70, size: 30 });
}

function uTimes(self, splits, index, space, step) {
  const pad = (n) => String(n).padStart(2, "0");
  const shown = (t) => {
    const d = new Date(t * 1000);
    if (step >= 86400) return step >= 20 * 86400 ? `${d.getFullYear()}-${pad(d.getMonth() + 1)}` : `${pad(d.getMonth() + 1)}-${pad(d.getDate())}`;
    const time = `${pad(d.getHours())}:${pad(d.getMinutes())}`;
    return step < 60 ? `${time}:${pad(d.getSeconds())}` : time;
  };
  return splits.map(shown);
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

export function spoken(values, unit, digits = 3) {
  const known = values.filter((value) => value !== null && value !== undefined);
  if (known.length === 0) return "no values";
  const show = (value) => Number(value.toPrecision(digits));
  return `last ${show(known.at(-1))} ${unit}, between ${show(Math.min(...known))} and ${show(Math.max(...known))} ${unit}`;
}
