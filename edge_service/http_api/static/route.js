// Address of what is shown: #/ is the machine, #/X an axis, #/X/why one of its tabs.

export const TABS = ["overview", "why", "history", "tests", "service"];

export function route() {
  const [axis, tab] = location.hash.replace(/^#\/?/, "").split("/").map(decoded);
  return { axis: axis || null, tab: TABS.includes(tab) ? tab : TABS[0] };
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
