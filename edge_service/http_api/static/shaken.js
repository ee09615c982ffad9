// The test by shaking of an axis with one encoder: why, what to do, and what the last one said.

import { element, write } from "./dom.js";
import { clock } from "./format.js";
import { eventWords } from "./sentence.js";
import { t } from "./strings.js";

const parts = {};

export function buildShaken() {
  parts.file = element("a", { class: "button", download: "chirp.csv" }, t("motion.csv"));
  parts.steps = element("div", {}, element("p", { class: "quiet" }, t("shaken.why")), element("ol", {}, element("li", {}, `${t("shaken.run")} `, parts.file), element("li", {}, t("shaken.seen"))));
  parts.said = element("p", {});
  parts.waiting = element("p", { role: "status" });
  return [parts.steps, parts.said, parts.waiting];
}

// Shown while a test is due, and with what the last one said.
export function renderShaken(card, { axis, preload, events }) {
  const isDue = (preload?.reasons ?? []).some((reason) => reason.startsWith("test_due:"));
  const last = events.findLast(({ kind }) => kind === "tested");
  card.hidden = !isDue && !last;
  parts.steps.hidden = !isDue;
  parts.file.href = `/api/v1/axes/${encodeURIComponent(axis)}/motions/chirp?format=csv`;
  const { text, lang } = last ? eventWords(last) : { text: "" };
  parts.said.lang = lang ?? "";
  write(parts.said, last ? `${clock(last.at)}: ${text}` : "");
  write(parts.waiting, isDue ? t("shaken.waiting") : "");
}
