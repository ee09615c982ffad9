// What changed, and what to do: sentences from the condition, the alarms and the trend.

import { clock, lasting, words } from "./dom.js";

const BY_REASON = [
  ["process_force", "Let the axis move without cutting for a few seconds: rapids or a warm-up program will do."],
  ["no_motion", "Move the axis: at rest nobody can tell its preload."],
  ["learning", "Let the axis go on moving for a few seconds."],
  ["insufficient_excitation", "Move the axis: at rest nobody can tell its preload."],
  ["stale_input", "Check the connection to the drive: no data come in."],
  ["no_input", "Check that the drive is on and connected: no data came in yet."],
  ["no_data", "Check the connection to the drive: no data come in."],
  ["no_limit", "Complete the machine file: the fresh screw's preload or load rating is missing."],
  ["confirming", "Wait a moment."],
  ["no_number", "Move the axis, and look at the data quality below."],
];

export function whatToDo(state) {
  const { health, preload, connected, condition } = state;
  if (!connected) return "Check the network and the service. Do not rely on what this page shows.";
  if (!health) return "Wait a moment.";
  const active = new Set(health.alarms.filter((alarm) => alarm.active).map((alarm) => alarm.alarm));
  const unseen = health.alarms.filter((alarm) => !alarm.acknowledged_by).length;
  const after = unseen ? " Acknowledge the alarm when you have taken note." : "";
  const fault = crossing(health.trend, "fault");
  if (condition === "FAULT") {
    const first = active.has("sudden_drop") ? "Stop the axis and look for damage: nut, balls, bearings, coupling. " : "";
    return `${first}Expect play and bad parts. Replace or re-adjust the nut, then write “part replaced” in the diary.${after}`;
  }
  if (active.has("model") || preload?.status === "invalid") {
    return `Do not trust the number. Check the data quality and the machine file; if they are right, something other than wear has changed: record a test and run a diagnosis.${after}`;
  }
  if (condition === "WARNING") return `Plan to replace the nut${fault ? ` before ${fault.first}` : ""}.${after}`;
  if (condition === "UNAVAILABLE") {
    const codes = [...health.reasons, ...(preload?.reasons ?? [])].map((reason) => reason.split(":")[0]);
    if (preload?.status === "insufficient_excitation") codes.push("insufficient_excitation");
    return BY_REASON.find(([code]) => codes.includes(code))?.[1] ?? "Look at the service and data quality below.";
  }
  if (active.has("rate")) return `It is all right now, but wears fast: look for the cause (load, lubrication, dirt)${fault ? `, and plan a new nut before ${fault.first}` : ""}.${after}`;
  if (health.trend?.status === "rising") return `Find out what changed: a new part, the lubrication, a repair? If a part was replaced, write “part replaced” in the diary.${after}`;
  return `Nothing.${after}`;
}

export function crossing(trend, limit) {
  const found = trend?.crossings.find((each) => each.limit === limit);
  if (!found?.earliest) return null;
  return { first: moment(found.earliest), last: found.latest ? moment(found.latest) : null, likely: found.likely ? moment(found.likely) : null };
}

function moment(time) {
  const seconds = (Date.parse(time) - Date.now()) / 1000;
  if (seconds < 172800) return `${clock(time)} (in ${lasting(Math.max(0, seconds))})`;
  return `${new Date(time).toLocaleDateString()} (in ${lasting(seconds)})`;
}

export function whatChanged(state) {
  const { health, events, condition } = state;
  const sentences = [];
  const sudden = health?.alarms.find((alarm) => alarm.alarm === "sudden_drop");
  if (sudden) sentences.push(`${words(sudden.message)} at ${clock(sudden.raised_at)}.`);
  if (condition !== "NORMAL") {
    const since = notNormalSince(events);
    if (since) sentences.push(`Not NORMAL since ${clock(since)}.`);
  }
  sentences.push(trendSentence(health?.trend));
  const part = events.findLast((event) => event.kind === "part_replaced");
  if (part) sentences.push(`Part replaced ${clock(part.time)}.`);
  return sentences.join(" ");
}

function notNormalSince(events) {
  const changes = events.filter((event) => event.kind === "condition_changed");
  const last = changes.findLastIndex((event) => event.data.to === "NORMAL");
  return changes[last + 1]?.time ?? null;
}

export function trendSentence(trend) {
  if (!trend || trend.status === "too_early") return "Too little history yet for a trend.";
  const since = `since ${clock(trend.since)}`;
  if (trend.status === "steady") return `No trend can be told ${since}, so there is no date.`;
  const [rate, unit] = readableRate(trend);
  const certain = `${(100 * trend.level).toFixed(0)} % sure`;
  const parts = [`The preload is ${trend.status} by ${rate("value")} % ${unit} ${since} (${certain}: ${rate("least")} to ${rate("most")}).`];
  if (trend.status === "rising") parts.push("Wear cannot do that: something else changed.");
  for (const [limit, name] of [["warning", "The warning limit"], ["fault", "The fault limit"]]) {
    const when = crossing(trend, limit);
    if (when) parts.push(when.last ? `${name} is reached between ${when.first} and ${when.last}.` : `${name} is not reached before ${when.first}.`);
  }
  return parts.join(" ");
}

function readableRate(trend) {
  const { value, low, high } = trend.rate_percent_per_h;
  const size = Math.abs(value);
  const [factor, unit] = size >= 1 ? [1 / 60, "per minute"] : size * 24 >= 0.05 ? [24, "per day"] : [24 * 365.25, "per year"];
  const sizes = { value: size, least: Math.min(Math.abs(low), Math.abs(high)), most: Math.max(Math.abs(low), Math.abs(high)) };
  return [(bound) => Number((factor * sizes[bound]).toPrecision(2)), unit];
}
