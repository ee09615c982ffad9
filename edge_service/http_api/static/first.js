// The first axis: recordings are read, examined and learned from; then the axis plays them until its driver is named.

import { byId, element, fetchJson, refill, write } from "./dom.js";
import { card, field, form, pathOf, sent } from "./form.js";
import { number } from "./format.js";
import { named, t } from "./strings.js";

const POLL_MS = 1000;
const FORMS = [".csv", ".parquet", ".txt", ".xml", ".json", ".mat"];
const QUANTITIES = ["time_s", "counter", "torque_command_nm", "current", "motor_angle_rad", "motor_speed_rad_s", "table_position_m", "table_speed_m_s", "position_setpoint_m", "position_error", "temperature_c", "external_force_n", "other"];
// What no recording tells: an answer takes the place of the question mark in an option of `edge-service adopt`.
const SHEET = { diameter: "--set=screw_diameter_m=?mm", rating: "--set=dynamic_load_rating_n=?kN", preload: "--set=preload_n=?N", mass: "--set=table_mass_kg=?kg" };
const MORE = { drag: "--set=preload_drag_nm=?N m", nut: "--set=nut_stiffness_n_per_m=?N/um", stroke: "--set=stroke_m=?mm", number: "--axis-number=?" };
const OPEN = { "--lead": "--set=lead_m=?mm", "--torque-constant": "--torque-constant=?", "--period": "--period=?" };
const FRESH = "--assume-fresh";
const parts = {};
let uploaded = []; // names of the recordings
let stated = new Map(); // column -> what its owner says of it
let axes = []; // configurations of those that are there

export function knowAxes(configured) {
  axes = configured;
  parts.name.value ||= [..."XYZABC"].find((letter) => !axes.some(({ axis }) => axis === letter)) ?? "";
}

const axisName = () => parts.name.value.trim();

export function firstCard() {
  parts.file = element("input", { id: "first-file", type: "file", required: "", multiple: "", accept: FORMS.join() });
  parts.name = element("input", { id: "first-name", required: "", maxlength: "100", pattern: "[A-Za-z0-9][A-Za-z0-9_.\\-]*" });
  parts.columns = element("ul", { class: "plain", "aria-label": t("first.columns") });
  parts.open = element("div", { class: "open" });
  parts.found = element("div", { id: "first-found" });
  parts.fresh = element("p", { class: "row", hidden: "" }, element("input", { id: "first-fresh", type: "checkbox" }), element("label", { for: "first-fresh" }, t("first.fresh")));
  for (const each of [parts.file, parts.name]) each.addEventListener("change", forget);
  const sheet = Object.entries(SHEET).map(([key, option]) => answer(key, t(`first.${key}`), option));
  const more = element("details", {}, element("summary", {}, t("first.more")), ...Object.entries(MORE).map(([key, option]) => answer(key, t(`first.${key}`), option)));
  const fields = [field("first-file", t("first.file"), parts.file), field("first-name", t("first.name"), parts.name), ...sheet, more, parts.columns, parts.open];
  return card("first", element("p", { class: "quiet" }, t("first.text")), form("first-form", fields, t("first.read"), read), parts.found);
}

function forget() {
  uploaded = [];
  stated = new Map();
  for (const each of [parts.columns, parts.found]) refill(each, "", () => []);
  parts.open.replaceChildren();
}

function answer(key, text, option) {
  const id = `first-${key}`;
  return field(id, text, element("input", { id, type: "number", min: "0", step: "any", "data-option": option }));
}

function given() {
  const typed = [...byId("first-form").querySelectorAll("[data-option]")].filter(({ value }) => value);
  return [...typed.map(({ value, dataset }) => dataset.option.replace("?", value)), ...[...stated].map(([name, holds]) => `--column=${holds.replace("?", name)}`)];
}

async function upload() {
  for (const file of uploaded.length ? [] : [...parts.file.files]) {
    const plain = `${axisName()}-${file.name.replace(/[^A-Za-z0-9_.\- ]/g, "_")}`;
    const name = FORMS.some((end) => plain.endsWith(end)) ? plain : `${plain}.txt`;
    say(t("upload.coming", { name }));
    await fetchJson(`/api/v1/recordings/${encodeURIComponent(name)}`, { method: "PUT", body: file });
    uploaded.push(name);
  }
}

const say = (words) => write(byId(byId("commission-form") ? "commission-form" : "first-form").querySelector("[role=status]"), words);

// A job to its end: its number and its answer. Raises what the command says.
async function done(command, options, seen = () => {}) {
  let job = await fetchJson("/api/v1/jobs", sent("POST", { command, axis: axisName(), recordings: uploaded, options }));
  while (job.state === "running") {
    const share = job.share === null ? "" : t("percent", { n: number(100 * job.share) });
    const stage = job.stage.startsWith("edge-service:") ? "" : job.stage; // its last word comes with its end
    say([`${named("job.command", command)} …`, share, stage].filter(Boolean).join(" "));
    await new Promise((go) => setTimeout(go, POLL_MS));
    job = await fetchJson(`/api/v1/jobs/${job.id}`);
  }
  const found = job.files.includes("answer.json") ? await fetchJson(fileOf(job, "answer.json")) : {};
  seen(found);
  const why = job.verdict ?? job.lines.at(-1) ?? named("job.state", job.state);
  if (why.includes("--axis-number")) byId("first-number").closest("details").open = true;
  if (job.state !== "done") throw new Error(why.replace(/\S*\/recordings\//g, ""));
  return { job, found };
}

const fileOf = ({ id }, name) => `/api/v1/jobs/${id}/files/${name}`;

async function read() {
  refill(parts.found, "", () => []);
  await upload();
  const { job, found } = await done("adopt", { given: given() }, showColumns);
  if (found.checks === null) throw new Error(t("first.incomplete"));
  const examined = await done("doctor", { machine: job.id });
  refill(parts.found, String(job.id), () => foundNodes(job, found, examined.found.findings));
  return "";
}

function showColumns({ columns = [], understood = [], unknown = [] }) {
  const about = (name) => ({ subject, words }) => subject !== "lead_m" && words.includes(`'${name}'`);
  const said = (guesses) => element("small", { lang: "en", class: "quiet" }, guesses.map(({ words }) => words).join("; "));
  const others = understood.filter((guess) => guess.subject !== "lead_m" && !columns.some(({ name }) => about(name)(guess)));
  refill(parts.columns, JSON.stringify([columns, understood]), () => [element("li", {}, element("h3", {}, t("first.columns"))), ...columns.map((each) => columnNode(each, said(understood.filter(about(each.name))))), element("li", {}, said(others))]);
  for (const { option, words } of unknown.filter(({ option }) => OPEN[option])) {
    if (!byId(`first${option}`)) parts.open.append(answer(option.slice(1), element("span", { lang: "en" }, words), OPEN[option]));
  }
}

function columnNode({ name, quantity, unit }, why) {
  const holds = element("select", { "aria-label": t("first.holds", { name }) }, ...QUANTITIES.map((value) => element("option", { value }, t(`first.quantity.${value}`))));
  const measured = element("input", { "aria-label": t("first.unit", { name }), value: unit, maxlength: "20" });
  holds.value = quantity;
  for (const each of [holds, measured]) each.addEventListener("change", () => stated.set(name, `${holds.value}=?:${measured.value.trim()}`));
  return element("li", { class: "row column" }, element("b", { lang: "en" }, name), holds, measured, why);
}

const MARKS = { fits: "ok", doubtful: "DOUBT", unknown: "?" };

function foundNodes(job, { found, understood }, findings) {
  const lead = understood.filter(({ subject }) => subject === "lead_m").map(({ words }) => `lead: ${words}`);
  const values = found.filter(({ low, high }) => low * high > 0).map(({ name, value, unit }) => `${name}: ${value.toPrecision(3)} ${unit}`);
  const lines = findings.map(({ name, verdict, sentence, remedy }) => element("li", { "data-verdict": verdict }, element("b", {}, MARKS[verdict]), ` ${name}: ${sentence}${remedy ? ` (${remedy})` : ""}`));
  return [
    element("h3", {}, t("first.found")),
    element("ul", { class: "plain", lang: "en" }, ...[...lead, ...values].map((line) => element("li", {}, line))),
    element("h3", {}, t("job.command.doctor")),
    element("ul", { class: "plain examined", lang: "en" }, ...lines),
    form("commission-form", [parts.fresh], t("first.commission"), () => commission(job.id)),
  ];
}

async function commission(machine) {
  const axis = axisName();
  const told = (answer) => (parts.fresh.hidden &&= !answer.error?.detail.includes(FRESH));
  const { job } = await done("commission", { machine, given: byId("first-fresh").checked ? [FRESH] : [] }, told);
  const file = fileOf(job, "commissioned.toml");
  parts.found.append(element("p", { class: "links" }, element("a", { href: file, download: `${axis}.toml`, lang: "en" }, "commissioned.toml")));
  const learned = await (await fetch(file)).text();
  const before = axes.find((each) => each.axis === axis) ?? { driver: "replay", settings: { path: `../../recordings/${uploaded[0]}`, loop: true } };
  await fetchJson(pathOf(axis), sent("PUT", { ...before, machine: learned }));
  location.assign(`#/${encodeURIComponent(axis)}`);
  location.reload();
}
