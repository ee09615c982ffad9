// One card per axis: condition first, then the number, then why.

import { element, list, svg, words, write } from "./dom.js";
import { History, draw } from "./plot.js";

const SYMBOLS = {
  NORMAL: ["M12 2a10 10 0 1 0 0 20 10 10 0 0 0 0-20z", "M7 12.5l3.5 3.5L17 9"],
  WARNING: ["M12 2.5L23 21.5H1z", "M12 9v6M12 18v.6"],
  FAULT: ["M8 2h8l6 6v8l-6 6H8l-6-6V8z", "M8.5 8.5l7 7M15.5 8.5l-7 7"],
  UNAVAILABLE: ["M12 2a10 10 0 1 0 0 20 10 10 0 0 0 0-20z", "M7 12h10"],
};
const STATUS_WORDS = {
  estimated: "",
  unestimated: "No estimate yet",
  insufficient_excitation: "The axis has not moved enough to tell",
  invalid: "Model and data disagree: no number",
};
const NO_CONNECTION = "connection: no connection to the service";

export class Card {
  constructor(axis, limits) {
    this.axis = axis;
    this.limits = limits;
    this.history = new History();
    this.preload = null;
    this.health = null;
    this.connected = true;
    this.parts = {};
    this.node = this.build();
  }

  get condition() {
    return this.connected ? (this.health?.condition ?? this.preload?.condition ?? "UNAVAILABLE") : "UNAVAILABLE";
  }

  take(answer, receivedMs) {
    this.preload = answer;
    this.receivedMs = receivedMs;
    this.history.add(answer);
  }

  build() {
    const part = (name, tag, className, ...children) => (this.parts[name] = element(tag, { class: className }, ...children));
    const title = `axis-${this.axis}`;
    return (this.parts.card = element(
      "article",
      { class: "card", id: `card-${this.axis}`, "aria-labelledby": title, tabindex: "-1" },
      element("div", { class: "card-head" }, element("h2", { id: title }, `Axis ${this.axis}`), part("badge", "p", "badge")),
      element(
        "div",
        { class: "reading" },
        element("p", { class: "value" }, part("value", "span", "number"), part("unit", "span", "unit", "%")),
        element("div", { class: "beside" }, part("interval", "p", "interval"), part("share", "p", "quiet")),
      ),
      (this.parts.gauge = svg("svg", { class: "gauge", viewBox: "0 0 420 26", role: "img" })),
      part("reasons", "ul", "reasons"),
      this.facts(part),
      (this.parts.plot = svg("svg", { class: "plot", role: "img" })),
      this.details(part),
    ));
  }

  facts(part) {
    const fact = (name, label, ...more) => element("div", {}, element("dt", {}, label), part(name, "dd", ""), ...more);
    return element(
      "dl",
      { class: "facts" },
      fact("drag", "Drag torque", part("drag-interval", "dd", "quiet")),
      fact("force", "Preload force"),
      fact("age", "Measured"),
    );
  }

  details(part) {
    return element(
      "details",
      {},
      element("summary", {}, "Details"),
      element("h3", {}, "Probability of each preload level"),
      part("modes", "ul", "modes"),
      element("h3", {}, "Data faults since start"),
      part("faults", "ul", "plain"),
      element("h3", {}, "Components"),
      part("components", "ul", "components"),
    );
  }

  render(nowMs, serverS) {
    const reading = this.connected ? this.preload : null;
    const { parts } = this;
    this.renderCondition();
    const percent = reading?.preload_percent ?? null;
    write(parts.value, percent === null ? "no value" : percent.toFixed(2));
    parts.value.classList.toggle("none", percent === null);
    parts.unit.hidden = percent === null;
    write(parts.interval, intervalText(reading, percent));
    write(parts.share, this.shareText(percent));
    list(parts.reasons, this.reasons(reading));
    const drag = reading?.drag_torque_nm ?? null;
    write(parts.drag, drag ? `${drag.value.toFixed(3)} N m` : "–");
    write(parts["drag-interval"], drag ? `${drag.low.toFixed(3)} – ${drag.high.toFixed(3)}` : "");
    write(parts.force, reading?.preload_n == null ? "–" : `${reading.preload_n.toFixed(0)} N`);
    write(parts.age, this.ageText(nowMs));
    this.renderGauge(reading, percent);
    this.renderModes(reading?.mode_probability ?? {});
    this.renderHealth();
    draw(parts.plot, this.history.runs(serverS), this.limits, serverS);
    parts.plot.setAttribute("aria-label", `Preload of axis ${this.axis} over the last 15 minutes`);
  }

  renderCondition() {
    const { badge, card } = this.parts;
    if (card.dataset.condition === this.condition) return;
    card.dataset.condition = this.condition;
    badge.replaceChildren(symbol(this.condition), element("span", {}, this.condition));
  }

  reasons(reading) {
    if (!this.connected) return [words(NO_CONNECTION)];
    const reasons = reading ? reading.reasons.map(words) : [];
    const status = STATUS_WORDS[reading?.status] ?? "";
    return reasons.length === 0 && status ? [status] : reasons;
  }

  shareText(percent) {
    if (!this.limits) return "no limits: fresh preload not known";
    const fresh = this.limits.fresh_percent;
    return percent === null
      ? `fresh screw: ${fresh.toFixed(2)} %`
      : `${((100 * percent) / fresh).toFixed(0)} % of the fresh screw (${fresh.toFixed(2)} %)`;
  }

  ageText(nowMs) {
    if (this.preload?.age_s == null) return "never";
    const age = this.preload.age_s + (nowMs - this.receivedMs) / 1000;
    if (age < 1) return "just now";
    if (age < 90) return `${age.toFixed(0)} s ago`;
    return age < 5400 ? `${(age / 60).toFixed(0)} min ago` : `${(age / 3600).toFixed(0)} h ago`;
  }

  renderGauge(reading, percent) {
    const { gauge } = this.parts;
    const limits = this.limits;
    gauge.setAttribute("aria-label", percent === null ? "no preload value" : `preload ${percent.toFixed(2)} percent`);
    gauge.classList.toggle("empty", limits === null);
    if (limits === null) return gauge.replaceChildren();
    const top = Math.max(limits.fresh_percent * 1.25, reading?.high ?? 0);
    const x = (value) => (Math.min(Math.max(value, 0), top) / top) * 420;
    const zone = (name, from, to) => svg("rect", { x: x(from), width: x(to) - x(from), y: 9, height: 8, class: `zone ${name}` });
    const marks = [
      zone("fault", 0, limits.fault_percent),
      zone("warning", limits.fault_percent, limits.warning_percent),
      zone("normal", limits.warning_percent, top),
      svg("line", { x1: x(limits.fresh_percent), x2: x(limits.fresh_percent), y1: 6, y2: 20, class: "fresh" }),
    ];
    if (percent !== null) {
      const low = x(reading.low ?? percent);
      const width = Math.max(x(reading.high ?? percent) - low, 2);
      marks.push(svg("rect", { x: low, width, y: 5, height: 16, rx: 3, class: "spread" }));
      marks.push(svg("rect", { x: x(percent) - 2, width: 4, y: 1, height: 24, rx: 2, class: "needle" }));
    }
    return gauge.replaceChildren(...marks);
  }

  renderModes(probabilities) {
    const levels = Object.keys(probabilities).sort((a, b) => b - a);
    if (levels.length === 0) return list(this.parts.modes, ["none"]);
    return this.parts.modes.replaceChildren(
      ...levels.map((level) => {
        const share = probabilities[level];
        const bar = element("progress", { max: 1, value: share, "aria-label": `level ${level} percent` });
        return element("li", { class: "mode" }, element("span", {}, `${level} %`), bar, element("span", {}, share.toFixed(2)));
      }),
    );
  }

  renderHealth() {
    const faults = Object.entries(this.health?.data_faults ?? {}).map(([kind, n]) => `${kind.replaceAll("_", " ")}: ${n}`);
    list(this.parts.faults, faults.length ? faults : ["none"]);
    list(this.parts.components, componentTexts(this.health?.components ?? []));
  }
}

export function componentTexts(components) {
  if (components.length === 0) return ["no report"];
  return components.map((each) => {
    const counters = Object.entries(each.counters).map(([name, n]) => `${name.replaceAll("_", " ")} ${n}`);
    const readings = Object.entries(each.readings).map(([name, x]) => `${name.replaceAll("_", " ")} ${x.toFixed(2)}`);
    const details = [...readings, ...counters];
    const reason = each.reason ? ` – ${each.reason}` : "";
    return `${each.component}: ${each.status.replaceAll("_", " ")}${reason}${details.length ? ` (${details.join(", ")})` : ""}`;
  });
}

function intervalText(reading, percent) {
  if (percent === null || reading.low === null || reading.high === null) return "";
  return `${reading.low.toFixed(2)} – ${reading.high.toFixed(2)} %`;
}

export function symbol(condition) {
  const [shape, sign] = SYMBOLS[condition];
  return svg(
    "svg",
    { viewBox: "0 0 24 24", class: "symbol", "aria-hidden": "true" },
    svg("path", { d: shape, class: "symbol-shape" }),
    svg("path", { d: sign, class: "symbol-sign" }),
  );
}
