// Step one of a test: a motion for the controller, within the limits of the axis.

import { element, fetchJson, refill } from "./dom.js";
import { lasting } from "./format.js";
import { named, t } from "./strings.js";

const FORMS = ["mpf", "csv"];
const parts = { shown: null, motions: [] };

export function buildMotions() {
  parts.choice = element("select", { id: "motion" });
  parts.choice.addEventListener("change", renderMotion);
  parts.about = element("p", {});
  parts.links = element("p", { class: "links" });
  return element("div", {}, element("p", { class: "quiet" }, t("motion.text")), element("label", { for: "motion" }, t("motion"), parts.choice), parts.about, parts.links);
}

export async function loadMotions(axis) {
  if (parts.shown === axis) return;
  parts.asked = axis;
  const { motions } = await fetchJson(`/api/v1/axes/${encodeURIComponent(axis)}/motions`);
  if (parts.asked !== axis) return; // another axis is shown by now
  Object.assign(parts, { motions, shown: axis });
  refill(parts.choice, JSON.stringify(motions), () => motions.map(({ name }) => element("option", { value: name }, named("motion", name))));
  renderMotion();
}

function renderMotion() {
  const motion = parts.motions.find(({ name }) => name === parts.choice.value);
  if (!motion) return;
  const refused = motion.refused ? element("span", { lang: "en" }, motion.refused) : null;
  const leftOut = motion.left_out.length ? [" ", t("motion.left_out"), " ", element("span", { lang: "en" }, `${motion.left_out.join("; ")}.`)] : [];
  parts.about.replaceChildren(named("motion.purpose", motion.name), " ", refused ?? t("motion.takes", { span: lasting(motion.duration_s) }), ...leftOut);
  const path = `/api/v1/axes/${encodeURIComponent(parts.shown)}/motions/${motion.name}`;
  parts.links.replaceChildren(...(refused ? [] : FORMS.map((form) => element("a", { class: "button", href: `${path}?format=${form}`, download: `${motion.name}.${form}` }, t(`motion.${form}`)))));
}

export function motionSeconds() {
  return parts.motions.find(({ name }) => name === parts.choice.value)?.duration_s ?? null;
}

export const motionName = () => parts.choice.value || null;
