// Numbers, times and spans as the reader of the page writes them.

import { counted, locale, t } from "./strings.js";

const STEPS = [[90, 1, "s"], [5400, 60, "min"], [172800, 3600, "h"], [5184000, 86400, "days"], [Infinity, 2629800, "months"]];
const timeOf = new Intl.DateTimeFormat(locale, { timeStyle: "medium" });
const dayOf = new Intl.DateTimeFormat(locale, { dateStyle: "medium" });

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

// "45 to 53 %" where the bounds are known.
export const between = (low, high, digits = 0) => t("between", { low: number(low, digits), high: number(high, digits) });
