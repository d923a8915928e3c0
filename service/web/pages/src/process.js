// The form of any process, from its description.
import { ask, BASE, showProblem } from "./api.js";
import { fields } from "./schema_form.js";

export async function storedLists() {
  const get = (path) => ask("GET", path).catch(() => ({ files: [], jobs: [] }));
  const [files, jobs] = await Promise.all([get("/files?limit=500"), get("/jobs?status=successful&processID=register&limit=200")]);
  const shown = (job) => `${new Date(job.created).toLocaleString(document.documentElement.lang)} · ${job.jobID.slice(0, 8)}`;
  return { files: files.files.map((file) => [file.id, file.name]), jobs: jobs.jobs.map((job) => [job.jobID, shown(job)]), stored: files.files };
}

export async function processForm(form, lists, skip = []) {
  const [description, interface_] = await Promise.all([ask("GET", `/processes/${form.dataset.process}`), ask("GET", "/openapi.json")]);
  const properties = Object.fromEntries(Object.entries(description.inputs).map(([name, each]) => [name, each.schema]));
  const required = Object.entries(description.inputs).filter(([, each]) => each.minOccurs > 0).map(([name]) => name);
  const inputs = fields({ properties, required }, lists, skip);
  form.querySelector("[data-inputs]").replaceChildren(...inputs.nodes);
  const outputs = fileOutputs(form.dataset.process, interface_, lists);
  if (outputs.nodes.length) {
    form.querySelector("[data-outputs]").replaceChildren(...outputs.nodes);
    form.querySelector("[data-outputs-section]").hidden = false;
  }
  return {
    inputs,
    body: (more = {}) => {
      const wanted = outputs.read();
      return { inputs: { ...inputs.read(), ...more }, ...(Object.keys(wanted).length ? { outputs: { ...described(description), ...wanted } } : {}) };
    },
  };
}

// once any output is named, only those that are named are given
const described = (description) => Object.fromEntries(Object.entries(description.outputs).filter(([, each]) => !isFiles(each.schema)).map(([name]) => [name, {}]));
const isFiles = (schema) => schema?.type === "array" && schema.items?.properties?.href !== undefined && schema.items?.properties?.points !== undefined;

function fileOutputs(process, document, lists) {
  const schemas = document.components.schemas;
  const name = process.split("-").map((part) => part.charAt(0).toUpperCase() + part.slice(1)).join("");
  const found = schemas[`${name}Outputs`];
  if (!found) return { nodes: [], read: () => ({}) };
  const expand = (node) => {
    if (Array.isArray(node)) return node.map(expand);
    if (!node || typeof node !== "object") return node;
    if (node.$ref) return { ...expand(schemas[node.$ref.split("/").at(-1)]), ...expand(Object.fromEntries(Object.entries(node).filter(([key]) => key !== "$ref"))) };
    const inside = Object.fromEntries(Object.entries(node).filter(([key]) => key !== "discriminator").map(([key, value]) => [key, expand(value)]));
    const options = (inside.anyOf || []).filter((each) => each.type !== "null");
    if (inside.anyOf && options.length < inside.anyOf.length) {
      const { anyOf, ...rest } = inside;
      return options.length === 1 ? { ...options[0], ...rest, nullable: true, default: rest.default ?? null } : { ...rest, anyOf: options, nullable: true };
    }
    return inside;
  };
  return fields({ properties: expand(found.properties) }, lists);
}

export function showRequest(form, body) {
  const place = form.querySelector("[data-request]");
  if (!place) return;
  try {
    place.textContent = `POST /processes/${form.dataset.process}/execution\n${JSON.stringify(body(), null, 2)}`;
  } catch (error) {
    place.textContent = error.message;
  }
}

export async function start(form, body) {
  const place = document.getElementById("problem");
  place.hidden = true;
  try {
    const job = await ask("POST", `/processes/${form.dataset.process}/execution`, body());
    if (job?.jobID) location.assign(`${BASE}/jobs/${job.jobID}`);
    else showAnswer(job);
  } catch (error) {
    showProblem(place, error);
  }
}

// of a process that answers at once
function showAnswer(answer) {
  const place = document.getElementById("answer");
  place.textContent = JSON.stringify(answer, null, 2);
  place.hidden = false;
  place.focus();
}

export async function wireProcess(form) {
  if (!form) return;
  const lists = await storedLists();
  try {
    const made = await processForm(form, lists);
    const show = () => showRequest(form, () => made.body());
    form.addEventListener("input", show);
    form.addEventListener("change", show);
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      show();
      start(form, () => made.body());
    });
    form.dataset.ready = "";
  } catch (error) {
    showProblem(document.getElementById("problem"), error);
  }
}
