// A form from a JSON Schema. What is left at its default is not sent, so that the service's own defaults hold.
import { element, put, read, words } from "./api.js";

const UNITS = { m: "m", m2: "m²", gon: "gon", deg: "°", px: "px", s: "s", rad: "rad", points: "" };
let made = 0;

export function label(name) {
  const parts = name.replace(/([a-z])([A-Z])/g, (all, one, other) => `${one}_${other.toLowerCase()}`).split("_");
  const unit = parts.length > 1 ? UNITS[parts.at(-1)] : undefined;
  if (unit) parts.pop();
  const own = words().options?.labels[name];
  const text = own || parts.join(" ");
  return `${text.charAt(0).toUpperCase()}${text.slice(1)}${unit ? ` [${unit}]` : ""}`;
}

// of the marks that descriptions have, those of code
export function explained(english, id) {
  const own = words().options?.help[english];
  const text = own || english;
  return element("p", { class: "help", id, lang: own ? document.documentElement.lang : undefined }, ...text.split("`").map((part, index) => (index % 2 ? element("code", {}, part) : part)));
}

const short = (value) => {
  const text = typeof value === "string" ? value : JSON.stringify(value);
  return text.length > 40 ? `${text.slice(0, 40)}…` : text;
};
const kindOf = (schema) => (schema.enum ? "enum" : schema.oneOf || schema.anyOf ? "one-of" : Array.isArray(schema.type) ? schema.type.find((each) => each !== "null") : schema.type);
const isPlain = (schema) => ["number", "integer", "string"].includes(kindOf(schema)) || kindOf(schema) === "enum";
const isNumber = (schema) => ["number", "integer"].includes(kindOf(schema));
const same = (one, other) => JSON.stringify(one) === JSON.stringify(other);

// Each field gives {node, read}: read() is undefined where nothing is to be sent, and throws where the text is no value.
export function field(name, schema, required, lists) {
  const id = `field-${(made += 1)}`;
  const kind = kindOf(schema);
  if (kind === "object" && schema.properties) return group(name, schema, required, lists);
  if (kind === "one-of") return choice(name, schema, required, lists);
  if (kind === "array" && kindOf(schema.items || {}) === "object" && schema.items.properties) return list(name, schema, required, lists);
  if (kind === "array" && isNumber(schema.items || {}) && schema.minItems === schema.maxItems && schema.minItems <= 4) return vector(name, schema, required, id);
  if (kind === "boolean") return truth(name, schema, required, id);
  if (kind === "enum") return selection(name, schema, required, id, schema.enum.filter((each) => each !== null).map((each) => [each, String(each)]));
  if (name === "file" && lists.files) return selection(name, schema, required, id, lists.files, words().choose_file);
  if ((name === "jobID" || name === "job_id") && lists.jobs) return selection(name, schema, required, id, lists.jobs, words().choose_job);
  if (isPlain(schema)) return text(name, schema, required, id);
  return json(name, schema, required, id);
}

function described(name, schema, required, id, control, inline = false) {
  const help = schema.description ? explained(schema.description, `${id}-help`) : null;
  if (help) control.setAttribute("aria-describedby", `${id}-help`);
  control.id = id;
  const title = element("label", { for: id }, label(name), required ? element("span", { class: "must", "aria-hidden": "true" }, " *") : null);
  if (required) control.setAttribute("aria-required", "true");
  return element("div", { class: inline ? "field inline" : "field", "data-field": name }, ...(inline ? [control, title] : [title, control]), help);
}

function text(name, schema, required, id) {
  const number = isNumber(schema);
  const placeholder = schema.default !== undefined && schema.default !== null ? put(words().default, { value: short(schema.default) }) : undefined;
  const control = element("input", { type: number ? "number" : "text", step: number ? (kindOf(schema) === "integer" ? 1 : "any") : undefined, min: schema.minimum, max: schema.maximum, maxlength: schema.maxLength, placeholder });
  return {
    node: described(name, schema, required, id, control),
    read: () => (control.value === "" ? (required && !number && schema.default === undefined ? "" : undefined) : number ? Number(control.value) : control.value),
  };
}

function truth(name, schema, required, id) {
  const normal = schema.default;
  if (schema.nullable || normal === undefined || normal === null) {
    return selection(name, schema, required, id, [[true, words().yes], [false, words().no]]);
  }
  const control = element("input", { type: "checkbox" });
  control.checked = normal;
  return { node: described(name, schema, false, id, control, true), read: () => (control.checked === normal ? undefined : control.checked) };
}

function selection(name, schema, required, id, options, nothing) {
  const normal = schema.default ?? null;
  const only = options.length === 1 && required && !nothing;
  const control = element("select", {}, normal === null && !only ? element("option", { value: "" }, nothing || words().unset) : null, ...options.map(([value, shown], index) => element("option", { value: index, selected: value === normal }, shown)));
  return {
    node: described(name, schema, required, id, control),
    read: () => {
      if (control.value === "") return undefined;
      const value = options[Number(control.value)][0];
      return value === normal && !required ? undefined : value;
    },
    control,
  };
}

function vector(name, schema, required, id) {
  const names = ["x", "y", "z", "w"];
  const normal = schema.default || [];
  const controls = Array.from({ length: schema.minItems }, (_, k) => element("input", { type: "number", step: "any", value: normal[k], "aria-label": `${label(name)} ${names[k]}` }));
  const box = element("div", { class: "vector", role: "group" }, ...controls);
  return {
    node: described(name, schema, required, id, box),
    read: () => {
      if (controls.every((each) => each.value === "")) return undefined;
      const value = controls.map((each) => Number(each.value));
      return same(value, normal) ? undefined : value;
    },
  };
}

function json(name, schema, required, id) {
  const control = element("textarea", { rows: 2, spellcheck: "false", placeholder: schema.default !== undefined && schema.default !== null ? put(words().default, { value: short(schema.default) }) : "JSON" });
  const wrong = element("p", { class: "help bad", hidden: true }, words().not_json);
  const node = described(name, schema, required, id, control);
  node.append(wrong);
  control.addEventListener("input", () => (wrong.hidden = control.value.trim() === "" || read(control.value) !== null));
  return {
    node,
    read: () => {
      const written = control.value.trim();
      if (written === "" || written === "null") return undefined;
      const value = read(written);
      if (value !== null) return value;
      if (kindOf(schema) === "string") return written;
      wrong.hidden = false;
      control.focus();
      throw new Error(`${label(name)}: ${words().not_json}`);
    },
  };
}

export function fields(schema, lists, skip = []) {
  const required = new Set(schema.required || []);
  const members = Object.entries(schema.properties || {})
    // an address in place of an identifier is for programs; here a file is chosen
    .filter(([name, each]) => !skip.includes(name) && !(each.type === "array" && each.maxItems === 0) && !(name === "href" && schema.properties.file) && name !== "transmissionMode")
    .map(([name, each]) => [name, field(name, each, required.has(name) || (name === "file" && "href" in schema.properties), lists)]);
  return {
    nodes: members.map(([, each]) => each.node),
    read: () => {
      const found = {};
      for (const [name, each] of members) {
        const value = each.read();
        if (value !== undefined) found[name] = value;
      }
      return found;
    },
    members: Object.fromEntries(members),
  };
}

function group(name, schema, required, lists) {
  let inside;
  const box = element("div", { class: "inside" });
  const fill = () => {
    if (inside) return;
    inside = fields(schema, lists);
    box.append(...inside.nodes);
  };
  const help = schema.description ? explained(schema.description) : null;
  if (required) {
    fill();
    return { node: element("fieldset", { "data-field": name }, element("legend", {}, label(name), element("span", { class: "must", "aria-hidden": "true" }, " *")), help, box), read: () => inside.read() };
  }
  // an object that is missing unless it is wanted, or one whose members have defaults of their own
  const absent = (schema.default === undefined || schema.default === null) && Boolean(schema.nullable || schema.required?.length);
  const wanted = absent ? element("input", { type: "checkbox", id: `field-${(made += 1)}` }) : null;
  const use = absent ? element("p", { class: "field inline" }, wanted, element("label", { for: wanted.id }, words().use)) : null;
  const details = element("details", { class: "group", "data-field": name, ontoggle: fill }, element("summary", {}, label(name)), help, use, box);
  if (wanted) {
    box.hidden = true;
    wanted.addEventListener("change", () => (box.hidden = !wanted.checked));
  }
  return {
    node: details,
    read: () => {
      if (!inside || (wanted && !wanted.checked)) return undefined;
      const value = inside.read();
      return absent || Object.keys(value).length ? value : undefined;
    },
  };
}

const optionsOf = (schema) => (schema.oneOf || schema.anyOf).filter((each) => each.type !== "null").flatMap((each) => (each.oneOf || each.anyOf ? optionsOf(each) : [each]));
function nameOf(option, key) {
  if (key && option.properties[key].enum) return option.properties[key].enum[0];
  if (option.enum?.length === 1) return String(option.enum[0]);
  if (kindOf(option) === "array" && option.items?.title) return `${label(option.items.title)}: ${words().list}`;
  return option.title ? label(option.title) : { array: "list", object: "object", string: "text" }[kindOf(option)] || kindOf(option) || "JSON";
}

function choice(name, schema, required, lists) {
  const options = optionsOf(schema);
  // a member of each option that has one value only says which it is
  const key = options.every((each) => each.properties) ? Object.keys(options[0].properties).find((each) => options.every((other) => other.properties[each]?.enum?.length === 1)) : undefined;
  const normal = schema.default;
  const isNormal = (option) => normal !== undefined && normal !== null && (key ? option.properties[key].enum[0] === (normal[key] ?? option.properties[key].default) : option.enum?.includes(normal) || false);
  const usual = key && normal !== undefined && normal !== null && !(key in normal) ? -1 : options.findIndex(isNormal);
  const id = `field-${(made += 1)}`;
  // where a job has done it already, its stations are what is meant
  const first = usual < 0 && required && lists.jobs?.length ? options.findIndex((each) => each.properties?.jobID) : usual;
  const free = usual < 0 && !required;
  const control = element("select", {}, free ? element("option", { value: "" }, normal !== undefined && normal !== null ? put(words().default, { value: short(normal) }) : normal === null ? words().unset : words().usual) : null, ...options.map((each, index) => element("option", { value: index, selected: index === first }, nameOf(each, key))));
  const box = element("div", { class: "inside" });
  const head = described(name, { description: schema.description }, required, id, control);
  let chosen = null;
  const show = () => {
    box.replaceChildren();
    chosen = null;
    if (control.value === "") return;
    const option = options[Number(control.value)];
    if (option.enum?.length === 1) {
      chosen = { read: () => option.enum[0] };
      return;
    }
    if (kindOf(option) === "object" && option.properties) {
      const inside = fields(option, lists, key ? [key] : []);
      chosen = { read: () => ({ ...(key ? { [key]: option.properties[key].enum[0] } : {}), ...inside.read() }) };
      const help = option.description && option.description !== schema.description ? explained(option.description) : null;
      if (key && inside.nodes.length) box.append(help || "", element("details", { class: "group" }, element("summary", {}, `${nameOf(option, key)}: options`), ...inside.nodes));
      else box.append(help || "", ...inside.nodes);
    } else {
      chosen = field(nameOf(option), option, true, lists);
      box.append(chosen.node);
    }
  };
  control.addEventListener("change", show);
  show();
  return {
    node: element("div", { class: "choice", "data-field": name }, head, box),
    read: () => {
      if (!chosen) return undefined;
      const value = chosen.read();
      if (control.value === String(usual) && (same(value, normal) || (key && Object.keys(value).length === 1))) return undefined;
      return value;
    },
  };
}

function list(name, schema, required, lists) {
  const entries = [];
  const rows = element("div", { class: "rows" });
  const add = () => {
    const inside = fields(schema.items, lists);
    const remove = element("button", { type: "button", class: "quiet", onclick: () => {
      entries.splice(entries.indexOf(inside), 1);
      box.remove();
    } }, words().remove);
    const box = element("fieldset", {}, element("legend", {}, `${label(name)} ${entries.length + 1}`), ...inside.nodes, remove);
    entries.push(inside);
    rows.append(box);
    return box;
  };
  for (let k = 0; k < (required ? schema.minItems || 0 : 0); k += 1) add();
  const button = element("button", { type: "button", onclick: () => add().querySelector("input,select,textarea")?.focus() }, words().add);
  return {
    node: element("div", { class: "list-field", "data-field": name, role: "group", "aria-label": label(name) }, element("p", { class: "list-title" }, label(name)), schema.description ? explained(schema.description) : null, rows, button),
    read: () => (entries.length || required ? entries.map((each) => each.read()) : undefined),
  };
}
