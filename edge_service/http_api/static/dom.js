// Elements without markup in strings: text from the bus can never become markup.

const SVG = "http://www.w3.org/2000/svg";

export const byId = (id) => document.getElementById(id);

export function element(tag, attributes = {}, ...children) {
  return filled(document.createElement(tag), attributes, children);
}

export function svg(tag, attributes = {}, ...children) {
  return filled(document.createElementNS(SVG, tag), attributes, children);
}

function filled(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}

export function button(text, attributes, act) {
  const node = element("button", { type: "button", ...attributes }, text);
  node.addEventListener("click", act);
  return node;
}

// Text is only written when it changes, so a selection or a screen reader is not disturbed.
export function write(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

// Children are only replaced when what they say changes.
export function refill(node, key, make) {
  if (node.dataset.key === key) return;
  node.dataset.key = key;
  node.replaceChildren(...make());
}

// The sentence of a reason `code: sentence`.
export function sentenceOf(reason) {
  const sentence = reason.replace(/^[a-z_]+: /, "");
  const isKey = /^\S*[._]\S/.test(sentence);
  return isKey ? sentence : sentence.charAt(0).toUpperCase() + sentence.slice(1);
}

// A sentence about a change, without the code within it.
export const withoutCode = (text) => text.replace(/: [a-z_]+: /, ": ");

// Items are { text, lang }: what the service says itself is English on every page.
export function list(node, items) {
  refill(node, JSON.stringify(items), () => items.map(({ text, lang }) => element("li", lang ? { lang } : {}, text)));
}

export async function fetchJson(path, options) {
  const response = await fetch(path, options);
  const answer = await response.json().catch(() => null);
  if (!response.ok) throw Object.assign(new Error(answer?.detail ?? `${path}: ${response.status}`), { status: response.status });
  return answer;
}

const SHAPES = {
  NORMAL: ["M12 2a10 10 0 1 0 0 20 10 10 0 0 0 0-20z", "M7 12.5l3.5 3.5L17 9"],
  WARNING: ["M12 2.5L23 21.5H1z", "M12 9v6M12 18v.6"],
  FAULT: ["M8 2h8l6 6v8l-6 6H8l-6-6V8z", "M8.5 8.5l7 7M15.5 8.5l-7 7"],
  UNAVAILABLE: ["M12 2a10 10 0 1 0 0 20 10 10 0 0 0 0-20z", "M7 12h10"],
};

export function symbol(level) {
  const [shape, sign] = SHAPES[level];
  const parts = [svg("path", { d: shape, class: "symbol-shape" }), svg("path", { d: sign, class: "symbol-sign" })];
  return svg("svg", { class: "symbol", viewBox: "0 0 24 24", "aria-hidden": "true" }, ...parts);
}
