// The same moves in kept recordings of several days: what changed since the first of them.

import { button, byId, element, fetchJson, refill, write } from "./dom.js";
import { clock } from "./format.js";
import { named, t } from "./strings.js";

const POLL_MS = 1000;
const parts = {};
let axis = null;
let polling = false;
let asked = 0;

function build() {
  parts.answer = element("div", {});
  parts.list = element("ul", { class: "plain", "aria-label": t("drift.recordings") });
  parts.start = button(t("drift.start"), { id: "drift-start", class: "primary" }, compare);
  parts.status = element("p", { role: "status" });
  byId("drift").replaceChildren(
    element("h2", { id: "drift-title" }, t("drift.title")),
    element("p", { class: "quiet" }, t("drift.what")),
    parts.answer,
    element("div", {}, parts.list, element("div", { class: "buttons" }, parts.start)),
    parts.status,
  );
}

export async function loadDrift(state) {
  if (!byId("drift").firstChild) build();
  axis = state.axis;
  const turn = ++asked;
  const [{ items: recordings }, { items: jobs }] = await Promise.all([fetchJson("/api/v1/recordings"), fetchJson("/api/v1/jobs")]);
  const job = jobs.find((each) => each.command === "fingerprint" && each.recordings.length > 1 && each.axis === state.axis);
  const verdict = job?.verdict ?? job?.lines.at(-1);
  if (turn !== asked) return; // the answer to a newer question is on its way
  refill(parts.list, JSON.stringify(recordings), () => (recordings.length ? recordings.map(recordingNode) : [element("li", { class: "quiet" }, t("drift.no_recordings"))]));
  refill(parts.answer, JSON.stringify([job ?? null, verdict ?? ""]), () => answerNodes(job, verdict));
  parts.start.disabled = jobs.filter((each) => each.state === "running").length > 1;
  if (job?.state === "running") poll(state);
  else if (parts.status.textContent === t("drift.started")) write(parts.status, "");
}

function poll(state) {
  if (polling) return;
  polling = true;
  setTimeout(() => {
    polling = false;
    if (state.axis === axis && !byId("history").hidden) loadDrift(state).catch(() => poll(state));
  }, POLL_MS);
}

function recordingNode({ name, from }) {
  const box = element("input", { type: "checkbox", name: "drift-recording", value: name, id: `drift-${name}` });
  box.checked = byId(box.id)?.checked ?? false; // a choice outlasts the list's renewal
  return element("li", { class: "row" }, box, element("label", { for: box.id }, from ? `${name}, ${clock(from)}` : name));
}

function answerNodes(job, verdict) {
  if (!job) return [element("p", { class: "quiet" }, t("drift.none"))];
  const nodes = [element("p", { id: "drift-verdict" }, `${named("drift", job.state)} `, element("span", { lang: "en" }, verdict ?? "")), element("p", { class: "quiet" }, job.recordings.join(" → "))];
  if (job.files.includes("report.html")) nodes.push(element("p", {}, element("a", { href: `/api/v1/jobs/${job.id}/files/report.html`, target: "_blank", rel: "noopener" }, t("drift.report"))));
  return nodes;
}

async function compare() {
  const newestFirst = [...parts.list.querySelectorAll(":checked")].map((box) => box.value);
  if (newestFirst.length < 2) return write(parts.status, t("drift.two"));
  const body = { command: "fingerprint", axis, recordings: newestFirst.reverse() };
  try {
    await fetchJson("/api/v1/jobs", { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) });
    write(parts.status, t("drift.started"));
  } catch (error) {
    write(parts.status, t("drift.failed_to_start", { why: error.message }));
  }
  await loadDrift({ axis }).catch(() => poll({ axis }));
}
