// The controls beside the picture: plain elements, so that keyboard and screen reader know them. All text is text, never markup.

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

export const KEYS = [
  ["Arrow keys", "turn (3-D) or shift (plan, sections)"],
  ["Shift + arrow keys", "shift"],
  ["+ and -", "nearer, farther"],
  ["1, 2, 3, 4", "3-D, plan, section along x, section along y"],
  ["0", "all of it"],
  ["[ and ]", "move the slab of a section"],
  ["C", "next colouring"],
  ["B", "before and after: first and last step of the registration"],
  ["A", "next alternative of a pair"],
  ["M", "measure a distance"],
  ["X or Enter", "take the point under the cross"],
  ["Backspace", "take back the last point"],
  ["Escape", "end measuring or picking, select nothing"],
];

export function keyTable() {
  return element(
    "details", { class: "viewer-keys" },
    element("summary", { text: "Keys (while the picture has the focus)" }),
    element("dl", {}, ...KEYS.flatMap(([keys, what]) => [element("dt", { text: keys }), element("dd", { text: what })])),
  );
}

export const metres = (value) => {
  const size = Math.abs(value);
  if (size < 0.1) return `${(value * 1000).toFixed(size < 0.01 ? 2 : 1)} mm`;
  return `${value.toFixed(4)} m`;
};
