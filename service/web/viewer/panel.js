// The controls beside the picture: plain elements, so that keyboard and screen reader know them. All text is text, never markup.

import { decimal, t } from "./words.js";

export function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name === "class") made.className = value;
    else if (name === "text") made.textContent = value;
    else if (["value", "checked", "disabled", "selected"].includes(name)) made[name] = value;
    else made.setAttribute(name, value === true ? "" : value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

let count = 0;

export function labelled(text, control) {
  control.id ||= `viewer-${count += 1}`;
  return element("span", { class: "viewer-field" }, element("label", { for: control.id, text }), control);
}

export function choice(options, chosen, onchange, extra = {}) {
  const select = element("select", { ...extra, onchange: () => onchange(select.value) });
  fill(select, options, chosen);
  return select;
}

export function fill(select, options, chosen) {
  select.replaceChildren(...options.map(([value, text]) => element("option", { value, text })));
  select.value = chosen;
}

export function toggle(text, checked, onchange, colour) {
  const box = element("input", { type: "checkbox", checked, onchange: () => onchange(box.checked) });
  const chip = colour ? element("span", { class: "viewer-chip" }) : null;
  if (chip) chip.style.backgroundColor = colour;
  return element("label", { class: "viewer-toggle" }, box, chip, document.createTextNode(text));
}

export function button(text, onclick, extra = {}) {
  return element("button", { type: "button", text, onclick, ...extra });
}

const KEYS = ["arrows", "shift", "zoom", "views", "zero", "slab", "c", "b", "a", "m", "x", "backspace", "escape"];

export function keyTable() {
  return element(
    "details", { class: "viewer-keys" },
    element("summary", { text: t("keys.title") }),
    element("dl", {}, ...KEYS.flatMap((key) => [element("dt", { text: t(`keys.${key}`) }), element("dd", { text: t(`keys.${key}_do`) })])),
  );
}

export const metres = (value) => {
  const size = Math.abs(value);
  if (size < 0.1) return `${decimal(value * 1000, size < 0.01 ? 2 : 1)} mm`;
  return `${decimal(value, 4)} m`;
};
