// The texts of the page's language, which the service puts into the page as it does for all that stands there.

let known;
let language = "en";

function texts() {
  if (!known) {
    known = JSON.parse(document.getElementById("viewer-words")?.textContent ?? "{}");
    language = known["language.code"] ?? "en";
  }
  return known;
}

// A text, its values put in; a key stands for itself where there is none.
export function t(key, values = {}) {
  return (texts()[key] ?? key).replace(/\{(\w+)\}/g, (all, name) => (name in values ? String(values[name]) : all));
}

// The word for a code of a document; the code itself where there is none.
export const word = (subject, code) => texts()[`${subject}.${code}`] ?? code;

export function decimal(value, decimals) {
  texts();
  return new Intl.NumberFormat(language, {
    minimumFractionDigits: decimals, maximumFractionDigits: decimals, useGrouping: false,
  }).format(value);
}
