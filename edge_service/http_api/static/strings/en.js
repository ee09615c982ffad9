// English: the words of the page, one key each. {names} are put in.

export const en = {
  "tabs": "Parts of the axis",
  "tab.overview": "Overview",
  "tab.why": "Why",
  "tab.history": "History",
  "tab.tests": "Tests",
  "tab.service": "Service",
};
