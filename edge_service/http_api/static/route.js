// Address of what is shown: #/ is the machine, #/X an axis, #/X/why one of its tabs.

export const TABS = ["overview", "why", "history", "tests", "service"];

export function route() {
  const [axis, tab] = location.hash.replace(/^#\/?/, "").split("/").map(decodeURIComponent);
  return { axis: axis || null, tab: TABS.includes(tab) ? tab : TABS[0] };
}

export function addressOf(axis, tab = TABS[0]) {
  return `#/${encodeURIComponent(axis)}${tab === TABS[0] ? "" : `/${tab}`}`;
}
