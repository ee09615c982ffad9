// Step two of a test: what the axis does is written to a recording while it moves.

import { button, element, fetchJson, write } from "./dom.js";
import { lasting } from "./format.js";
import { motionName, motionSeconds } from "./motions.js";
import { t } from "./strings.js";

const MARGIN_S = 20; // to press start at the controller
const parts = {};

export function buildRecorder(axisOf, done) {
  const act = (method, body) => send(axisOf(), method, body).then(done).catch((error) => write(parts.status, t("failed", { why: error.message })));
  parts.status = element("p", { role: "status" });
  parts.bar = element("progress", { max: 1, value: 0, "aria-label": t("record.progress"), hidden: "" });
  parts.start = button(t("record.start"), { id: "record-start", class: "primary" }, () => act("POST", { motion: motionName() ?? "", seconds: Math.ceil((motionSeconds() ?? 60) + MARGIN_S) }));
  parts.stop = button(t("record.stop"), { id: "record-stop", hidden: "" }, () => act(STOP[0]));
  return element("div", {}, element("p", { class: "quiet" }, t("record.text")), element("div", { class: "buttons" }, parts.start, parts.stop), parts.bar, parts.status);
}

async function send(axis, method, body) {
  const options = body ? { headers: { "content-type": "application/json" }, body: JSON.stringify(body) } : {};
  await fetchJson(`/api/v1/axes/${encodeURIComponent(axis)}/recording`, { method, ...options });
}

export function renderRecorder(axis, live) {
  const isOther = parts.axis !== axis;
  const wasLive = !parts.bar.hidden;
  const wasHeard = parts.bar.value > 0;
  parts.axis = axis;
  parts.start.hidden = Boolean(live);
  parts.stop.hidden = parts.bar.hidden = !live;
  if (live) {
    parts.bar.value = Math.min(live.recorded_s / live.seconds, 1);
    write(parts.status, t("record.live", { axis: live.axis, span: lasting(live.recorded_s), of: lasting(live.seconds) }));
  } else if (isOther) write(parts.status, "");
  else if (wasLive) write(parts.status, t(wasHeard ? "record.done" : "record.nothing"));
}
