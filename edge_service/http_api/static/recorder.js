// Step two of a test: a job writes what the axis does to a recording while it moves.

import { button, element, fetchJson, write } from "./dom.js";
import { lasting } from "./format.js";
import { motionName, motionSeconds } from "./motions.js";
import { t } from "./strings.js";

const MARGIN_S = 20; // to press start at the controller
const parts = {};

export function buildRecorder(axisOf, done) {
  const act = (request) => request.then(done).catch((error) => write(parts.status, t("failed", { why: error.message })));
  parts.status = element("p", { role: "status" });
  parts.bar = element("progress", { max: 1, value: 0, "aria-label": t("record.progress"), hidden: "" });
  parts.start = button(t("record.start"), { id: "record-start", class: "primary" }, () => act(record(axisOf())));
  parts.stop = button(t("record.stop"), { id: "record-stop", hidden: "" }, () => act(fetchJson(`/api/v1/jobs/${parts.job.id}`, { method: "DELETE" })));
  return element("div", {}, element("p", { class: "quiet" }, t("record.text")), element("div", { class: "buttons" }, parts.start, parts.stop), parts.bar, parts.status);
}

function record(axis) {
  const stamp = new Date().toISOString().replace(/[-:]|\.\d+/g, "");
  const options = { duration_s: Math.ceil((motionSeconds() ?? 60) + MARGIN_S) };
  const body = { command: "record", axis, recordings: [`${motionName() ?? "live"}_${axis}_${stamp}.parquet`], options };
  return fetchJson("/api/v1/jobs", { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) });
}

export function renderRecorder(axis, jobs) {
  const isOther = parts.axis !== axis;
  const before = isOther ? null : parts.job;
  parts.axis = axis;
  parts.job = jobs.find((job) => job.command === "record" && job.axis === axis && job.state === "running");
  parts.start.hidden = Boolean(parts.job);
  parts.stop.hidden = parts.bar.hidden = !parts.job;
  if (parts.job) {
    const of = parts.job.options.duration_s;
    parts.bar.value = parts.job.share ?? 0;
    write(parts.status, t("record.live", { axis, span: lasting(parts.bar.value * of), of: lasting(of) }));
  } else if (isOther) write(parts.status, "");
  else if (before) {
    const ended = jobs.find((job) => job.id === before.id);
    write(parts.status, ended?.state === "done" ? t("record.done") : t("failed", { why: ended?.verdict ?? "" }));
  }
}
