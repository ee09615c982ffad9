// Step three of a test: fingerprints and diagnoses of recordings, how far they are and what they say.

import { button, element, fetchJson, refill, write } from "./dom.js";
import { clock, lasting, number, serverMs } from "./format.js";
import { named, t } from "./strings.js";

const KINDS = ["fingerprint", "diagnose", "update"];
const verdicts = new Map(); // job -> what its diagnosis says

export function startForm(parts, start) {
  parts.kind = element("select", { id: "job-kind" }, ...KINDS.map((value) => element("option", { value }, t(`job.command.${value}`))));
  parts.baseline = element("select", { id: "job-baseline" });
  parts.start = button(t("job.start"), { id: "job-start", class: "primary" }, start);
  return element("div", {}, element("label", { for: "job-kind" }, t("job.make"), parts.kind), element("label", { for: "job-baseline" }, t("job.compare"), parts.baseline), element("div", { class: "buttons" }, parts.start));
}

export async function readVerdicts(jobs) {
  await Promise.all(jobs.filter((job) => job.files.includes("diagnosis.json") && job.state === "done" && !verdicts.has(job.id)).map(readVerdict));
}

export function renderJobs(list, jobs, cancel) {
  const open = new Set([...list.querySelectorAll("details[open]")].map((node) => node.dataset.job));
  refill(list, JSON.stringify([jobs, [...verdicts.keys()]]), () => (jobs.length ? jobs.map((job) => jobNode(job, cancel, open)) : [element("li", { class: "quiet" }, t("job.none"))]));
  for (const job of jobs.filter(({ state }) => state === "running")) renderProgress(list.querySelector(`[data-progress="${job.id}"]`), job);
}

async function readVerdict(job) {
  const found = await fetchJson(fileOf(job, "diagnosis.json")).catch(() => null);
  if (found) verdicts.set(job.id, found);
}

const fileOf = (job, name) => `/api/v1/jobs/${job.id}/files/${encodeURIComponent(name)}`;

function jobNode(job, cancel, open) {
  const head = element("p", {}, element("b", {}, `${named("job.command", job.command)} ${job.id}`), ` · ${t("job.axis", { axis: job.axis })} · ${clock(job.ended ?? job.started)} · ${named("job.state", job.state)}`);
  const node = element("li", { class: "job", "data-state": job.state }, head, job.state === "running" ? progressNode(job) : verdictNode(job), filesNode(job));
  if (job.state === "running") node.append(element("div", { class: "buttons" }, button(t("job.cancel"), { "aria-label": t("job.cancel.label", { n: job.id }) }, () => cancel(job))));
  if (job.lines.length) node.append(logNode(job, open.has(String(job.id))));
  return node;
}

function logNode(job, isOpen) {
  const node = element("details", { "data-job": job.id }, element("summary", {}, t("job.log")), element("pre", { tabindex: "0", lang: "en" }, job.lines.join("\n")));
  node.open = isOpen;
  return node;
}

// One bar: the share that is done, the stage and the time left.
function progressNode(job) {
  return element("div", { class: "progress", "data-progress": job.id }, element("progress", { max: 1, "aria-label": t("job.progress") }), element("p", {}));
}

function renderProgress(node, job) {
  node.querySelector("progress").value = job.share ?? 0;
  const took = (serverMs() - Date.parse(job.started)) / 1000;
  const left = job.left_s === null ? "" : t("job.left", { span: lasting(job.left_s) });
  write(node.querySelector("p"), [job.stage ? `${job.stage}.` : "", left, t("job.since", { span: lasting(took) })].filter(Boolean).join(" "));
}

function verdictNode(job) {
  const found = verdicts.get(job.id);
  if (job.state !== "done" || job.command === "update") return element("p", { class: "job-verdict", lang: "en" }, job.verdict ?? job.lines.at(-1) ?? "");
  if (!found) return element("p", { class: "job-verdict" }, t("job.ready"));
  const causes = found.effects.filter((effect) => effect.probability >= 0.5).slice(0, 3).map(causeWords);
  const verdict = found.verdict === "explained" && found.partly ? "partly" : found.verdict;
  return element("p", { class: "job-verdict" }, [named("verdict", verdict), ...causes].join(" "));
}

function causeWords({ name, probability, parameters }) {
  const about = { name: named("effect", name), n: number(100 * probability) };
  const lost = parameters?.lost_percent;
  if (!lost) return t("verdict.cause", about);
  const [value, low, high] = [lost.value, Math.floor(lost.low ?? 0), Math.ceil(lost.high ?? 100)].map((each) => number(each));
  return t("verdict.cause.lost", { ...about, value, low, high });
}

function filesNode(job) {
  const links = job.files.map((name) => {
    const open = name.endsWith(".html") ? { target: "_blank", rel: "noopener" } : { download: `${job.command}_${job.id}_${name}` };
    return element("a", { href: fileOf(job, name), lang: "en", ...open }, name);
  });
  return element("p", { class: "links" }, ...links);
}
