// Gravity of an axis: the worst of its condition and of its open alarms.

export const ORDER = ["FAULT", "WARNING", "UNAVAILABLE", "NORMAL"];

export const openAlarms = (state) => state.health?.alarms ?? [];

// An alarm on an axis that is NORMAL by its preload still calls for somebody.
export function levelOf(state) {
  const calls = openAlarms(state).some((alarm) => alarm.active && alarm.severity !== "info");
  return state.condition === "NORMAL" && calls ? "WARNING" : state.condition;
}

export const worstFirst = (states) => [...states].sort((a, b) => ORDER.indexOf(levelOf(a)) - ORDER.indexOf(levelOf(b)));
