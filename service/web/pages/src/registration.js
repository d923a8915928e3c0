// A new registration: files are sent (and go on after a break), stations are named after them, options chosen.
import * as tus from "tus-js-client";
import { ask, BASE, element, PAGE, put, read, showProblem, words } from "./api.js";
import { field } from "./schema_form.js";
import { processForm, showRequest, start, storedLists } from "./process.js";

const RETRY_AFTER_MS = [0, 1000, 3000, 5000, 10000, 20000];

// as the service names stations of uploads: what may stand in tables, pages and names of files
export function stationName(filename, index, several, taken) {
  const stem = filename.replace(/\.[^.]*$/, "") || filename;
  const cleaned = stem.replace(/[^\p{L}\p{N}_ .()+-]/gu, "_").slice(0, 48);
  const base = /^[\p{L}\p{N}_]/u.test(cleaned) ? cleaned : `scan${cleaned}`;
  const wanted = several ? `${base}-${index + 1}` : base;
  let name = wanted;
  for (let number = 2; taken.has(name); number += 1) name = `${wanted} (${number})`;
  return name;
}

export async function wireRegistration(form) {
  if (!form) return;
  const find = (id) => document.getElementById(id);
  const language = document.documentElement.lang;
  const uploads = new Map(); // of the list, by a number: {file document, or what is under way}
  const stations = [];
  const photos = [];
  let numbers = 0;
  let photoSchema = null;
  const lists = await storedLists();

  find("stored").append(...lists.stored.filter((file) => file.kind !== "mesh").map((file) => element("option", { value: file.id }, file.name)));
  find("add-stored").addEventListener("click", () => {
    const chosen = lists.stored.find((file) => file.id === find("stored").value);
    if (chosen && ![...uploads.values()].some((each) => each.document?.id === chosen.id)) arrived(entry(chosen.name), chosen);
  });

  const drop = find("drop");
  for (const name of ["dragenter", "dragover"]) drop.addEventListener(name, (event) => (event.preventDefault(), drop.classList.add("over")));
  for (const name of ["dragleave", "drop"]) drop.addEventListener(name, () => drop.classList.remove("over"));
  drop.addEventListener("drop", (event) => (event.preventDefault(), [...event.dataTransfer.files].forEach(send)));
  find("choose").addEventListener("change", (event) => {
    [...event.target.files].forEach(send);
    event.target.value = "";
  });

  function entry(name) {
    const number = (numbers += 1);
    const state = element("span", { class: "small", "data-state": "" }, words().waiting);
    const bar = element("progress", { max: 100, value: 0, "aria-label": name });
    const remove = element("button", { type: "button", class: "quiet", "aria-label": `${words().remove}: ${name}`, onclick: () => forget(number) }, words().remove);
    const node = element("li", {}, element("span", { class: "file-name" }, name), state, bar, remove);
    find("uploads").append(node);
    const made = { number, node, state, bar, busy: false, document: null, sending: null };
    uploads.set(number, made);
    return made;
  }

  function send(file) {
    const made = entry(file.name);
    made.busy = true;
    made.sending = new tus.Upload(file, {
      endpoint: `${BASE}/uploads`,
      retryDelays: RETRY_AFTER_MS,
      headers: PAGE,
      metadata: { filename: file.name },
      removeFingerprintOnSuccess: true,
      onProgress: (sent, all) => {
        const percent = Math.floor((100 * sent) / all);
        made.bar.value = percent;
        say(made, sent < all ? put(words().sent, { percent }) : words().inspecting, sent < all ? "" : "busy");
        if (sent >= all) made.bar.removeAttribute("value");
      },
      onSuccess: async () => {
        try {
          arrived(made, await ask("GET", `/files/${new URL(made.sending.url).pathname.split("/").pop()}`));
        } catch (error) {
          failed(made, error.message);
        }
      },
      onError: (error) => {
        const problem = read(error.originalResponse?.getBody() || "");
        failed(made, problem?.detail || problem?.title || words().unreachable);
      },
    });
    const begin = () => made.sending.start();
    // the same file that was begun in another visit goes on where it stopped
    made.sending.findPreviousUploads().then((found) => {
      if (found.length) made.sending.resumeFromPreviousUpload(found[0]);
      begin();
    }, begin);
    update();
  }

  function say(made, text, kind) {
    made.state.textContent = text;
    made.node.className = kind;
  }

  function failed(made, why) {
    made.busy = false;
    made.bar.hidden = true;
    say(made, put(words().refused, { why }), "bad");
    update();
  }

  function arrived(made, document) {
    if (!uploads.has(made.number)) return;
    made.busy = false;
    made.document = document;
    made.bar.hidden = true;
    const points = document.scans.reduce((sum, scan) => sum + scan.points, 0);
    const what = [document.scans.length ? put(words().scans, { count: document.scans.length, points: points.toLocaleString(language) }) : "", document.photos.length ? put(words().photo_count, { count: document.photos.length }) : "", ...(document.warnings || [])];
    say(made, put(words().inspected, { what: what.filter(Boolean).join("; ") || document.kind }), "good");
    if (document.scans.length) document.scans.filter((scan) => scan.usable !== false).forEach((scan) => addStation(made, document, scan));
    else document.photos.filter((photo) => !photo.refused).forEach((photo) => addPhoto(made, document, photo));
    update();
  }

  function addStation(made, document, scan) {
    const taken = new Set(stations.map((each) => each.name.value));
    const id = `station-${made.number}-${scan.index}`;
    const name = element("input", { id, type: "text", maxlength: 64, value: stationName(document.name, scan.index, document.scans.length > 1, taken), oninput: update });
    const unit = element("select", { "aria-label": `${words().unit}: ${document.name}`, onchange: update }, ...[["", `${words().unit}: ${words().as_declared}`], ["m", "m"], ["mm", "mm"], ["ft", "ft"], ["us-ft", "us-ft"]].map(([value, shown]) => element("option", { value }, shown)));
    const own = document.photos.filter((photo) => !photo.refused && photo.scan === scan.index && photo.camera && photo.scan_from_camera).map((photo) => ({ file: document.id, index: photo.index }));
    const uses = own.length && own.length <= 200 ? element("input", { type: "checkbox", id: `${id}-photos`, onchange: update }) : null;
    if (uses) uses.checked = true;
    const node = element("div", { class: "row" }, element("label", { for: id }, words().name), name, unit, uses ? element("span", { class: "inline" }, uses, element("label", { for: uses.id }, put(words().own_photos, { count: own.length }))) : null, element("span", { class: "small" }, `${document.name}${document.scans.length > 1 ? ` · ${scan.name}` : ""} · ${scan.points.toLocaleString(language)}`), scan.open_unit ? element("span", { class: "small bad" }, scan.open_unit) : null);
    stations.push({
      made, name, node,
      read: () => ({ name: name.value, scan: { file: document.id, index: scan.index, ...(unit.value ? { unit: unit.value } : {}) }, photos: uses?.checked ? own : [] }),
    });
    // in the order in which the files were given, whichever was inspected first: the first gives the common frame
    stations.sort((one, other) => one.made.number - other.made.number);
    find("station-rows").append(...stations.map((each) => each.node));
  }

  function addPhoto(made, document, photo) {
    const id = `photo-${made.number}-${photo.index}`;
    const station = element("select", { id, onchange: update });
    const { file, index, ...rest } = photoSchema?.properties || {};
    const inside = field("camera and mounting", { type: "object", properties: photoProperties(rest, photo), default: {} }, false, {});
    const node = element("div", { class: "photo" }, element("div", { class: "row" }, element("span", { class: "file-name" }, document.name), element("label", { for: id }, words().station), station), inside.node);
    photos.push({ made, station, node, read: () => ({ file: document.id, index: photo.index, ...(inside.read() || {}) }) });
    find("photo-rows").append(node);
  }

  function photoProperties(properties, photo) {
    const size = { width: photo.width, height: photo.height };
    const camera = properties.camera?.properties ? { ...properties.camera, properties: { ...properties.camera.properties } } : null;
    if (camera) for (const [name, value] of Object.entries(size)) camera.properties[name] = { ...camera.properties[name], description: `${camera.properties[name]?.description || ""} (${value})` };
    return camera ? { ...properties, camera } : properties;
  }

  function forget(number) {
    const made = uploads.get(number);
    if (made.sending && made.busy) made.sending.abort(true);
    uploads.delete(number);
    made.node.remove();
    for (const rows of [stations, photos]) for (const each of rows.filter((row) => row.made === made)) (each.node.remove(), rows.splice(rows.indexOf(each), 1));
    update();
  }

  const reportLanguage = () => form.querySelector("[data-field=report] [data-field=lang] select");
  form.addEventListener("toggle", async () => {
    await new Promise((done) => setTimeout(done)); // until the group that was opened has its fields
    const choice = reportLanguage();
    if (!choice || choice.dataset.preset) return;
    choice.dataset.preset = "yes";
    choice.selectedIndex = [...choice.options].findIndex((each) => each.textContent === language);
  }, true);

  function body() {
    const listed = stations.map((each) => each.read());
    for (const photo of photos) listed[Number(photo.station.value)]?.photos.push(photo.read());
    const whole = made.body({ stations: listed });
    // the report in the language of who orders it, unless the form was asked
    if (language !== "en" && !reportLanguage()) whole.inputs.report = { lang: language, ...whole.inputs.report };
    return whole;
  }

  function update() {
    find("stations-section").hidden = !stations.length;
    find("photos-section").hidden = !photos.length;
    for (const photo of photos) {
      const chosen = photo.station.value || "0";
      photo.station.replaceChildren(...stations.map((each, index) => element("option", { value: index, selected: String(index) === chosen }, each.name.value)));
    }
    const busy = [...uploads.values()].some((each) => each.busy);
    find("hint").textContent = busy ? words().busy : stations.length < 2 ? words().few : "";
    find("start").dataset.wait = busy || stations.length < 2 ? "yes" : "";
    if (made) showRequest(form, body);
  }

  let made = null;
  try {
    made = await processForm(form, lists, ["stations"]);
    const description = await ask("GET", `/processes/${form.dataset.process}`);
    photoSchema = description.inputs.stations.schema.items.properties.photos.items;
  } catch (error) {
    showProblem(find("problem"), error);
  }
  form.addEventListener("input", () => made && showRequest(form, body));
  form.addEventListener("change", () => made && showRequest(form, body));
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    if (find("start").dataset.wait === "yes") {
      find("hint").focus();
      return;
    }
    start(form, body);
  });
  update();
  form.dataset.ready = "";
}
