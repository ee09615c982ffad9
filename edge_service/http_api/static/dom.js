// Elements without markup in strings: text from the bus can never become markup.

const SVG = "http://www.w3.org/2000/svg";

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

// Text is only written when it changes, so a selection or a screen reader is not disturbed.
export function write(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

export function words(reason) {
  const sentence = reason.replace(/^[a-z_]+: /, "");
  const isKey = /^\S*[._]\S/.test(sentence);
  return isKey ? sentence : sentence.charAt(0).toUpperCase() + sentence.slice(1);
}

export function list(node, texts) {
  const present = [...node.children].map((item) => item.textContent);
  if (present.length === texts.length && texts.every((text, i) => text === present[i])) return;
  node.replaceChildren(...texts.map((text) => element("li", {}, text)));
}
