// Address of what is shown: #/ is the machine, #/X an axis, #/X/why one of its tabs, #/service and #/setup pages.

export const TABS = ["overview", "why", "history", "tests"];
export const PAGES = ["service", "setup"];

export function route() {
  const [first, tab] = location.hash.replace(/^#\/?/, "").split("/").map(decoded);
  const page = PAGES.includes(first) ? first : null;
  return { page, axis: page ? null : first || null, tab: TABS.includes(tab) ? tab : TABS[0] };
}

// Whatever somebody typed has a meaning: a broken escape stands for itself.
function decoded(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}

export function addressOf(axis, tab = TABS[0]) {
  return `#/${encodeURIComponent(axis)}${tab === TABS[0] ? "" : `/${tab}`}`;
}
