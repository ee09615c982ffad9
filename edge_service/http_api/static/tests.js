// A test in three steps: choose a motion, record it, see what it says.

import { comparison } from "./compare.js";
import { button, byId, element, fetchJson, refill, write } from "./dom.js";
import { clock, number } from "./format.js";
import { readVerdicts, renderJobs, startForm } from "./jobs.js";
import { buildMotions, loadMotions } from "./motions.js";
import { buildRecorder, renderRecorder } from "./recorder.js";
import { buildShaken, renderShaken } from "./shaken.js";
import { t } from "./strings.js";

const POLL_MS = 1000;
const parts = {};
let axis = null;
let polling = false;
let asked = 0;

export function renderTests(state) {
  if (!parts.file) build();
  renderShaken(byId("shaken"), state);
}

function build() {
  parts.file = element("input", { type: "file", multiple: "", accept: ".csv,.parquet", id: "job-file" });
  parts.file.addEventListener("change", upload);
  parts.list = element("ul", { class: "plain", "aria-label": t("recordings") });
  parts.status = element("p", { role: "status" });
  parts.jobs = element("ul", { class: "plain", "aria-label": t("job.list") });
  const form = startForm(parts, startJob);
  byId("tests").replaceChildren(
    card("shaken", t("shaken"), ...buildShaken()),
    card("step-motion", t("step.motion"), buildMotions()),
    card("step-record", t("step.record"), buildRecorder(() => axis, again), element("label", { for: "job-file" }, t("upload"), parts.file)),
    card("step-result", t("step.result"), element("div", { class: "small-charts" },
      element("div", {}, element("h3", {}, t("recordings")), parts.list),
      element("div", {}, form, parts.status))),
    card("jobs", t("job.list"), parts.jobs),
    card("compare", t("compare"), ...compareNodes()),
  );
}

function card(id, title, ...children) {
  return element("section", { id, class: "panel wide", "aria-labelledby": `${id}-title` }, element("h2", { id: `${id}-title` }, title), ...children);
}

function compareNodes() {
  parts.left = element("select", { id: "compare-left" });
  parts.right = element("select", { id: "compare-right" });
  parts.table = element("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": t("compare") });
  for (const select of [parts.left, parts.right]) select.addEventListener("change", compare);
  return [element("div", { class: "small-charts" }, element("label", { for: "compare-left" }, t("compare.left"), parts.left), element("label", { for: "compare-right" }, t("compare.right"), parts.right)), parts.table];
}

export async function loadTests(state) {
  axis = state.axis;
  const turn = ++asked;
  const paths = ["recordings", "jobs"];
  const [{ items: recordings }, { items: jobs }] = await Promise.all(paths.map((path) => fetchJson(`/api/v1/${path}`)));
  await readVerdicts(jobs);
  if (turn !== asked) return; // the answer to a newer question is on its way
  loadMotions(axis).catch(() => {});
  renderRecorder(axis, jobs);
  refill(parts.list, JSON.stringify(recordings), () => (recordings.length ? recordings.map(recordingNode) : [element("li", { class: "quiet" }, t("recordings.none"))]));
  renderJobs(parts.jobs, jobs, cancel);
  renderChoices(jobs);
  const running = jobs.some((job) => job.state === "running");
  parts.start.disabled = jobs.filter((job) => job.state === "running").length > 1;
  if (!running && parts.status.textContent === t("job.started")) write(parts.status, t("job.over"));
  if (running) poll();
}

const again = () => loadTests({ axis });

function renderChoices(jobs) {
  const fingerprints = jobs.filter((job) => job.files.includes("fingerprint.json"));
  const choices = fingerprints.map((job) => [String(job.id), `${t("job.command.fingerprint")} ${job.id}, ${clock(job.started)}`]);
  options(parts.baseline, [["", t("job.compare.nothing")], ...choices]);
  for (const select of [parts.left, parts.right]) options(select, [["", t("compare.choose")], ...choices]);
  byId("compare").hidden = fingerprints.length < 2;
}

function options(select, choices) {
  const chosen = select.value;
  refill(select, JSON.stringify(choices), () => choices.map(([value, name]) => element("option", { value }, name)));
  if (choices.some(([value]) => value === chosen)) select.value = chosen;
}

function poll() {
  if (polling) return;
  polling = true;
  setTimeout(() => {
    polling = false;
    if (!byId("tests").hidden) again().catch(poll); // of the axis that is shown by now
  }, POLL_MS);
}

function recordingNode(recording) {
  const { name, bytes } = recording;
  const box = element("input", { type: "checkbox", name: "recording", value: name, id: `recording-${name}` });
  box.checked = byId(box.id)?.checked ?? false; // a choice outlasts the list's renewal
  const shown = bytes > 1e6 ? `${number(bytes / 1e6, 1)} MB` : `${number(bytes / 1e3, 1)} kB`;
  const link = element("a", { href: pathOf(name), download: name, "aria-label": t("recording.download.label", { name }) }, t("recording.download"));
  const remove = () => button(t("remove"), { "aria-label": `${t("remove")} ${name}` }, () => act(fetchJson(pathOf(name), { method: "DELETE" }), t("removed")));
  return element("li", { class: "row" }, box, element("label", { for: box.id, lang: "en" }, `${name} (${shown})`), link, remove());
}

const pathOf = (name) => `/api/v1/recordings/${encodeURIComponent(name)}`;
const cancel = (job) => act(fetchJson(`/api/v1/jobs/${job.id}`, { method: "DELETE" }), t("job.cancelled"));

async function upload() {
  for (const file of parts.file.files) {
    write(parts.status, t("upload.coming", { name: file.name }));
    await act(fetchJson(pathOf(file.name), { method: "PUT", body: file }), t("upload.done", { name: file.name }));
  }
  parts.file.value = "";
}

async function startJob() {
  const recordings = [...byId("tests").querySelectorAll("[name=recording]:checked")].map((box) => box.value);
  if (recordings.length === 0) return write(parts.status, t("job.choose"));
  const body = { command: parts.kind.value, axis, recordings, options: { baseline: parts.baseline.value && parts.kind.value === "fingerprint" ? Number(parts.baseline.value) : null } };
  await act(fetchJson("/api/v1/jobs", { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) }), t("job.started"));
}

async function act(request, done) {
  try {
    await request;
    write(parts.status, done);
  } catch (error) {
    write(parts.status, t("failed", { why: error.message }));
  }
  await again().catch(poll);
}

async function compare() {
  const chosen = [parts.left.value, parts.right.value];
  const table = chosen.every(Boolean) ? await comparison(chosen).catch((error) => t("failed", { why: error.message })) : "";
  if (chosen[0] === parts.left.value && chosen[1] === parts.right.value) parts.table.replaceChildren(table);
}
