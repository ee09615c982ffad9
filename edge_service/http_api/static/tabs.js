// Tabs of an axis, after the tab pattern of ARIA: links, so that each has its address.

import { byId, element, refill } from "./dom.js";
import { TABS, addressOf } from "./route.js";
import { t } from "./strings.js";

const STEPS = { ArrowLeft: -1, ArrowRight: 1 };

export function renderTabs(axis, shown) {
  const root = byId("tabs");
  root.hidden = false;
  refill(root, `${axis}/${shown}`, () => {
    const hadFocus = root.contains(document.activeElement);
    const nodes = TABS.map((tab) => tabNode(axis, tab, tab === shown));
    if (hadFocus) queueMicrotask(() => byId(`tab-${shown}`).focus());
    return nodes;
  });
  for (const tab of TABS) byId(tab).hidden = tab !== shown;
}

export function hideTabs() {
  for (const id of ["tabs", ...TABS]) byId(id).hidden = true;
}

function tabNode(axis, tab, selected) {
  const attributes = { id: `tab-${tab}`, role: "tab", class: "tab", href: addressOf(axis, tab), "aria-selected": String(selected), "aria-controls": tab, tabindex: selected ? "0" : "-1" };
  return element("a", attributes, t(`tab.${tab}`));
}

function move(event) {
  const at = TABS.findIndex((tab) => `tab-${tab}` === event.target.id);
  const next = event.key === "Home" ? 0 : event.key === "End" ? TABS.length - 1 : event.key in STEPS ? (at + STEPS[event.key] + TABS.length) % TABS.length : at;
  if (at < 0 || next === at) return;
  event.preventDefault();
  byId(`tab-${TABS[next]}`).focus();
  byId(`tab-${TABS[next]}`).click();
}

byId("tabs").addEventListener("keydown", move);
