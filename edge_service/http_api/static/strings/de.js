// German: the same keys as in English.

export const de = {
  "tabs": "Teile der Achse",
  "tab.overview": "Übersicht",
  "tab.why": "Warum",
  "tab.history": "Verlauf",
  "tab.tests": "Tests",
  "tab.service": "Dienst",
};
