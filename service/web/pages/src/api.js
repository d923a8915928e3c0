// Requests to the service, as any program would send them, with the word that one of its own pages asks.
// where the service is, below which path of its host
export const BASE = document.documentElement.dataset.base || "";
export const PAGE = { "Tieline-Page": "1" };

export class Refused extends Error {
  constructor(problem) {
    super(problem.detail || problem.title);
    this.problem = problem;
  }
}

export async function ask(method, path, body) {
  const headers = { Accept: "application/json", ...PAGE };
  if (body !== undefined) headers["Content-Type"] = "application/json";
  let answer;
  try {
    answer = await fetch(BASE + path, { method, headers, body: body === undefined ? undefined : JSON.stringify(body) });
  } catch {
    throw new Refused({ title: words().unreachable || "unreachable", detail: "" });
  }
  const text = await answer.text();
  const document = text ? read(text) : null;
  if (!answer.ok) throw new Refused(document && document.title ? document : { title: `${answer.status} ${answer.statusText}` });
  return document;
}

export function read(text) {
  try {
    return JSON.parse(text);
  } catch {
    return null;
  }
}

let known;
export function words() {
  if (!known) known = read(document.getElementById("words")?.textContent || "{}") || {};
  return known;
}

export const put = (text, values) => text.replace(/\{(\w+)\}/g, (all, name) => (name in values ? values[name] : all));

// everything that comes from users or the service goes in as text, never as markup
export function element(name, attributes = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === false || value === undefined || value === null) continue;
    if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else made.setAttribute(key, value === true ? "" : value);
  }
  made.append(...children.filter((child) => child !== null && child !== undefined));
  return made;
}

export function showProblem(place, error) {
  const problem = error.problem || { title: String(error.message || error) };
  place.replaceChildren(element("p", {}, element("strong", {}, words().wrong || ""), " ", problem.title, problem.detail && !problem.errors?.length ? ` – ${problem.detail}` : ""));
  if (problem.errors?.length)
    place.append(element("ul", { lang: "en" }, ...problem.errors.map((each) => element("li", {}, element("code", {}, each.pointer || ""), " ", each.detail || ""))));
  place.hidden = false;
  place.focus();
  place.scrollIntoView({ block: "nearest" });
}
