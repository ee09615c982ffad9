// Diary: what happened, and what was done about it.

import { ask } from "./ask.js";
import { button, byId, element, refill } from "./dom.js";
import { clock } from "./format.js";
import { eventWords } from "./sentence.js";
import { t } from "./strings.js";

const SHOWN = 60;
let shown = null;

export function renderDiary(state) {
  const root = byId("diary");
  if (!root.firstChild) {
    root.replaceChildren(
      element("div", { class: "panel-head" }, element("h2", { id: "diary-title" }, t("diary")), noteButtons()),
      element("ol", { class: "events", tabindex: "0", "aria-labelledby": "diary-title" }),
    );
  }
  shown = state;
  const events = state.events.slice(-SHOWN).reverse();
  refill(root.querySelector("ol"), `${state.axis}${events.length}${events[0]?.id}`, () => (events.length ? events.map(eventNode) : [element("li", { class: "quiet" }, t("diary.empty"))]));
}

function noteButtons() {
  const act = (action) => button(t(`diary.${action}`), {}, () => ask([shown.axis], { action }, t(`diary.${action}`), t(`diary.${action}.text`)));
  return element("div", { class: "buttons" }, act("note"), act("part_replaced"));
}

export function eventNode(event) {
  const { text, lang } = eventWords(event);
  return element(
    "li",
    { class: `event ${event.level}` },
    element("time", { datetime: event.at, title: event.at }, clock(event.at)),
    element("span", { class: "event-axis" }, event.axis || t("service")),
    element("span", { class: "event-level" }, t(`condition.${event.level}`)),
    element("span", { class: "event-text", ...(lang ? { lang } : {}) }, text),
  );
}
