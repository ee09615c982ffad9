// Numbers, times and spans as the reader of the page writes them.

import { counted, locale, t } from "./strings.js";

const STEPS = [[90, 1, "s"], [5400, 60, "min"], [172800, 3600, "h"], [5184000, 86400, "days"], [Infinity, 2629800, "months"]];
const timeOf = new Intl.DateTimeFormat(locale, { timeStyle: "medium" });
const dayOf = new Intl.DateTimeFormat(locale, { dateStyle: "medium" });

let offsetMs = Date.now() - performance.now(); // until the service has told its time
export const serverMs = () => performance.now() + offsetMs;
export const setServerTime = (time) => (offsetMs = Date.parse(time) - performance.now());

export const number = (value, digits = 0) => value.toLocaleString(locale, { minimumFractionDigits: digits, maximumFractionDigits: digits });
export const significant = (value, digits = 3) => value.toLocaleString(locale, { maximumSignificantDigits: digits });
export const day = (time) => dayOf.format(new Date(time));

export function clock(time) {
  const moment = new Date(time);
  const hours = timeOf.format(moment);
  return moment.toDateString() === new Date().toDateString() ? hours : `${day(moment)} ${hours}`;
}

export function lasting(seconds) {
  const [, size, unit] = STEPS.find(([below]) => seconds < below);
  return counted(`span.${unit}`, Math.max(0, Math.round(seconds / size)));
}

// Percent of the fresh screw, from percent of the load rating.
export const ofFresh = (percent, limits) => (100 * percent) / limits.fresh_percent;

// A value and its bounds, "45 to 53 %": bounds are rounded outwards, with as many digits as keep the value off them.
export function printed({ value, low, high }, digits = 0) {
  const rounded = (more) => {
    const [least, most] = [Math.floor(Number((low * 10 ** more).toFixed(6))), Math.ceil(Number((high * 10 ** more).toFixed(6)))];
    return [Math.min(Math.max(Math.round(value * 10 ** more), least), most), least, most];
  };
  const isOff = ([middle, least, most]) => least < middle && middle < most;
  const used = [0, 1, 2, 3].map((more) => digits + more).find((more) => isOff(rounded(more))) ?? digits;
  const [middle, least, most] = rounded(used).map((each) => (each / 10 ** used).toLocaleString(locale, { maximumFractionDigits: used }));
  return { value: middle, low: least, high: most, bounds: t("between", { low: least, high: most }) };
}
