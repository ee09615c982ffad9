// Tests on request: upload recordings, make a fingerprint or a diagnosis, read and compare.

import { button, byId, clock, element, fetchJson, refill, write } from "./dom.js";
import { ifMay, may } from "./session.js";

const KINDS = { fingerprint: "Fingerprint", diagnose: "Diagnosis" };
const UPLOAD = ["PUT", "/api/v1/recordings/{name}"];
const REMOVE = ["DELETE", "/api/v1/recordings/{name}"];
const START = ["POST", "/api/v1/jobs"];
const CANCEL = ["DELETE", "/api/v1/jobs/{number}"];
const POLL_MS = 1000;
const READABLE = { m: [1e6, "µm"], "N/m": [1e-6, "N/µm"], "kg m^2": [1e4, "kg cm²"] };
const UNIT_IN_NAME = /_(n_per_m|hz|m|kg_m2|nm_s_per_rad|nm|n|rad)$/;
const STARTED = "Started. It takes up to some minutes; the page may be closed meanwhile.";
const parts = {};
let axis = null;
let polling = false;
let asked = 0;

function build() {
  parts.file = element("input", { type: "file", multiple: "", accept: ".csv,.parquet", id: "job-file" });
  parts.list = element("ul", { class: "plain", "aria-label": "Recordings" });
  parts.kind = element("select", { id: "job-kind" }, ...Object.entries(KINDS).map(([value, name]) => element("option", { value }, name)));
  parts.baseline = element("select", { id: "job-baseline" });
  parts.status = element("p", { role: "status" });
  parts.jobs = element("ul", { class: "plain", "aria-label": "Jobs" });
  parts.left = element("select", { id: "compare-left" });
  parts.right = element("select", { id: "compare-right" });
  parts.table = element("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": "Comparison" });
  parts.file.addEventListener("change", upload);
  for (const select of [parts.left, parts.right]) select.addEventListener("change", compare);
  parts.start = button("Start", { id: "job-start", class: "primary" }, startJob);
  byId("tests").replaceChildren(element("section", { class: "panel wide", "aria-labelledby": "tests-title" },
    element("h2", { id: "tests-title" }, "Tests: fingerprint and diagnosis"),
    element("p", { class: "quiet" }, "Record a test motion (edge-service record), upload the trace, and let the service compare the axis with its model or with an older fingerprint."),
    element("div", { class: "small-charts" },
      element("div", {}, ifMay(UPLOAD, "To upload recordings", () => element("label", { for: "job-file" }, "Upload recordings (CSV or Parquet)", parts.file)), parts.list, ifMay(REMOVE, "To remove recordings", () => "")),
      element("div", {}, ifMay(START, "To make a fingerprint or a diagnosis", startForm), parts.status),
    ),
    element("h3", {}, "Jobs"),
    parts.jobs,
    element("h3", {}, "Two fingerprints side by side"),
    element("div", { class: "small-charts" }, element("label", { for: "compare-left" }, "Left", parts.left), element("label", { for: "compare-right" }, "Right", parts.right)),
    parts.table,
  ));
}

function startForm() {
  return element("div", {}, element("label", { for: "job-kind" }, "Make a"), parts.kind, element("label", { for: "job-baseline" }, "Compare with"), parts.baseline, element("div", { class: "buttons" }, parts.start));
}

export async function loadTests(state) {
  if (!parts.file) build();
  axis = state.axis;
  const turn = ++asked;
  const [{ recordings }, { jobs }] = await Promise.all([fetchJson("/api/v1/recordings"), fetchJson("/api/v1/jobs")]);
  if (turn !== asked) return; // the answer to a newer question is on its way
  refill(parts.list, JSON.stringify(recordings), () => (recordings.length ? recordings.map(recordingNode) : [element("li", { class: "quiet" }, "No recording yet.")]));
  refill(parts.jobs, JSON.stringify(jobs), () => (jobs.length ? jobs.map(jobNode) : [element("li", { class: "quiet" }, "No job yet.")]));
  const fingerprints = jobs.filter((job) => job.files.includes("fingerprint.json"));
  const choices = fingerprints.map((job) => [String(job.id), `Fingerprint ${job.id}, ${clock(job.started)}`]);
  options(parts.baseline, [["", "nothing"], ...choices]);
  for (const select of [parts.left, parts.right]) options(select, [["", "choose"], ...choices]);
  const running = jobs.some((job) => job.state === "running");
  parts.start.disabled = running;
  if (!running && parts.status.textContent === STARTED) write(parts.status, `It is ${jobs[0]?.state ?? "over"}: see below.`);
  if (running) poll(state);
}

function options(select, choices) {
  const chosen = select.value;
  refill(select, JSON.stringify(choices), () => choices.map(([value, name]) => element("option", { value }, name)));
  if (choices.some(([value]) => value === chosen)) select.value = chosen;
}

function poll(state) {
  if (polling) return;
  polling = true;
  setTimeout(() => {
    polling = false;
    loadTests(state).catch(() => poll(state));
  }, POLL_MS);
}

function recordingNode(recording) {
  const box = element("input", { type: "checkbox", name: "recording", value: recording.name, id: `recording-${recording.name}` });
  box.checked = byId(box.id)?.checked ?? false; // a choice outlasts the list's renewal
  const size = recording.size > 1e6 ? `${(recording.size / 1e6).toFixed(1)} MB` : `${(recording.size / 1e3).toFixed(1)} kB`;
  const remove = () => button("Remove", { "aria-label": `Remove ${recording.name}` }, () => act(fetchJson(`/api/v1/recordings/${encodeURIComponent(recording.name)}`, { method: "DELETE" }), "Removed."));
  return element("li", { class: "row" }, may(START) ? box : "", element("label", { for: box.id }, `${recording.name} (${size})`), may(REMOVE) ? remove() : "");
}

function jobNode(job) {
  const took = job.state === "running" ? `running since ${clock(job.started)}` : `${job.state} ${clock(job.ended ?? job.started)}`;
  const node = element("li", { class: "row" }, element("span", {}, `${KINDS[job.kind]} ${job.id}: ${took}. `));
  for (const name of job.files) {
    const open = name.endsWith(".html") ? { target: "_blank", rel: "noopener" } : { download: `${job.kind}_${job.id}_${name}` };
    node.append(element("a", { href: `/api/v1/jobs/${job.id}/files/${encodeURIComponent(name)}`, ...open }, name), " ");
  }
  if (job.state === "running" && may(CANCEL)) node.append(button("Cancel", { "aria-label": `Cancel job ${job.id}` }, () => act(fetchJson(`/api/v1/jobs/${job.id}`, { method: "DELETE" }), "Cancelled.")));
  if (job.lines.length) node.append(element("pre", { tabindex: "0" }, job.lines.join("\n")));
  return node;
}

async function upload() {
  for (const file of parts.file.files) {
    write(parts.status, `Uploading ${file.name} …`);
    await act(fetchJson(`/api/v1/recordings/${encodeURIComponent(file.name)}`, { method: "PUT", body: file }), `${file.name} is here.`);
  }
  parts.file.value = "";
}

async function startJob() {
  const recordings = [...byId("tests").querySelectorAll("[name=recording]:checked")].map((box) => box.value);
  if (recordings.length === 0) return write(parts.status, "Choose at least one recording.");
  const body = { kind: parts.kind.value, axis, recordings, baseline: parts.baseline.value && parts.kind.value === "fingerprint" ? Number(parts.baseline.value) : null };
  await act(fetchJson("/api/v1/jobs", { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) }), STARTED);
}

async function act(request, done) {
  try {
    await request;
    write(parts.status, done);
  } catch (error) {
    write(parts.status, `It did not work: ${error.message}`);
  }
  await loadTests({ axis }).catch(() => poll({ axis }));
}

async function compare() {
  if (!parts.left.value || !parts.right.value) return;
  const [left, right] = await Promise.all([parts.left, parts.right].map((select) => fetchJson(`/api/v1/jobs/${select.value}/files/fingerprint.json`)));
  const rows = [];
  for (const section of Object.keys(left.sections)) {
    const names = new Set([left, right].flatMap((each) => Object.keys(each.sections[section]?.figures ?? {})));
    for (const name of names) rows.push(row(section, name, left.sections[section]?.figures[name], right.sections[section]?.figures[name]));
  }
  const head = ["Test", "Figure", "Left", "Right", "Changed beyond doubt"].map((text) => element("th", { scope: "col" }, text));
  parts.table.replaceChildren(element("table", {}, element("thead", {}, element("tr", {}, ...head)), element("tbody", {}, ...rows)));
}

function row(section, name, left, right) {
  const known = left?.low != null && right?.low != null;
  const changed = known ? (left.high < right.low || right.high < left.low ? "yes" : "no") : "not known";
  const cells = [section, name.replace(UNIT_IN_NAME, "").replaceAll("_", " "), shown(left), shown(right), changed];
  return element("tr", { "data-state": changed === "yes" ? "faulty" : "ok" }, ...cells.map((text) => element("td", {}, text)));
}

function shown(figure) {
  if (figure?.value == null) return "–";
  const [scale, unit] = READABLE[figure.unit] ?? [1, figure.unit];
  const digits = (value) => Number((scale * value).toPrecision(4));
  const bounds = figure.low == null ? "" : ` (${digits(figure.low)} to ${digits(figure.high)})`;
  return `${digits(figure.value)} ${unit}${bounds}`;
}
