// Put the viewer into the page: <div id="viewer" data-job="..."> gets a picture, its controls, and what is said of both.

import { ManualHelp } from "./manual_help.js";
import { button, choice, element, fill, keyTable, labelled, metres, toggle } from "./panel.js";
import { distanceWithStd } from "./poses.js";
import { KINDS, Viewer } from "./viewer.js";
import { VIEWS } from "./views.js";

const COLOURINGS = [
  ["station", "station"], ["intensity", "intensity"], ["rgb", "colour of the scan"], ["height", "height"],
  ["std", "standard deviation of position"],
];
const KIND_TITLES = {
  points: "points", lines: "lines", edges: "edges of photos", planes: "planes", cylinders: "cylinders",
  instruments: "instruments", pieces: "pieces that speak against a pair",
};

const MOST_ROWS = 500;

class Application {
  constructor(root) {
    this.root = root;
    this.job = root.dataset.job;
    this.measuring = false;
    this.measured = [];
    this.status = element("p", { class: "viewer-status", role: "status", "aria-live": "polite", text: "loading" });
    root.classList.add("viewer");
    root.append(this.status);
  }

  get base() { return base(); }

  get here() { return `${base()}/jobs/${encodeURIComponent(this.job)}`; }

  say(text) { if (this.status.textContent !== text) this.status.textContent = text; }

  async start() {
    let answer;
    try {
      answer = await fetch(`${this.here}/scene`, { credentials: "same-origin", headers: { Accept: "application/json" } });
    } catch {
      this.say("The service does not answer; reload the page to try again.");
      return;
    }
    if (!answer.ok) {
      const problem = await answer.json().catch(() => ({}));
      this.say(problem.detail ?? problem.title ?? `There is nothing to show: the service answers ${answer.status}.`);
      return;
    }
    this.data = await answer.json();
    for (const cloud of this.data.clouds) if (cloud.href) cloud.href = base() + cloud.href;
    this._build();
  }

  _build() {
    const { data } = this;
    this.canvas = element("canvas", {
      tabindex: "0", role: "application", "aria-label": "3-D view of the scans; its keys are listed below it",
    });
    this.cross = element("div", { class: "viewer-cross", "aria-hidden": "true" });
    this.picture = element("div", { class: "viewer-picture" }, this.canvas, this.cross);
    this.info = element("div", { class: "viewer-info", "aria-live": "polite" });
    this.legend = element("div", { class: "viewer-legend" });
    this.toolbar = element("div", { class: "viewer-tools", role: "group", "aria-label": "What is shown" });
    this.root.append(this.toolbar, element("div", { class: "viewer-body" }, this.picture, element(
      "div", { class: "viewer-side" }, this.legend, this.info,
    )), keyTable());
    try {
      this.viewer = new Viewer(this.canvas, data, {
        changed: () => this._drawn(),
        failed: (error) => this.say(error.message),
        selected: (id) => this._selected(id),
        first: (ms, bytes) => this._first(ms, bytes),
      });
    } catch (error) {
      this.say(`This browser cannot draw in 3-D (WebGL 2): ${error.message}`);
      return;
    }
    this.help = new ManualHelp(this);
    this._tools();
    this._listen();
    this.choosePair(data.stations.length === 2 && data.pairs[0]?.status !== "accepted" && data.pairs.length ? 0 : null);
    const gone = data.clouds.filter((cloud) => !cloud.href).map((cloud) => cloud.station);
    this.say(gone.length ? `The points of ${gone.join(", ")} are gone with the uploaded file; all else is shown.` : "loading points");
  }

  _first(ms, bytes) {
    this.root.dataset.firstPictureMs = ms.toFixed(0);
    this.root.dataset.firstPictureBytes = String(bytes);
    if (this.status.textContent === "loading points") this.say("");
  }

  _drawn() {
    this.root.dataset.points = String(this.viewer.detail.shown);
    this.root.dataset.loading = String(this.viewer.detail.loading + (this.viewer.isMoving ? 1 : 0));
  }

  // --- controls

  _tools() {
    const { data, viewer } = this;
    const pairs = data.pairs.map((pair, k) => [String(k), `pair ${pair.target} – ${pair.source}: ${pair.status}`]);
    this.scope = choice([["", "all stations"], ...pairs], "", (value) => this.choosePair(value === "" ? null : Number(value)));
    this.step = element("input", {
      type: "range", min: "0", max: String(data.stages.length - 1), step: "0.05", value: String(data.stages.length - 1),
      oninput: () => this.chooseStage(Number(this.step.value)),
    });
    this.stepTitle = element("output");
    this.steps = element("span", { class: "viewer-group" }, labelled("before / after", this.step), this.stepTitle);
    this.alternative = choice([], "", (value) => this.chooseAlternative(Number(value)));
    this.beside = choice([], "", (value) => this.chooseBeside(value === "" ? null : Number(value)));
    this.alternatives = element(
      "span", { class: "viewer-group" }, labelled("pose", this.alternative), labelled("beside it", this.beside),
    );
    this.colouring = choice(
      COLOURINGS.filter(([mode]) => viewer.can(mode)), viewer.colouring, (mode) => this.chooseColouring(mode),
    );
    this.featuresBy = choice(
      [["state", "state in the adjustment"], ["residual", "residual over its limit"], ["station", "station"]], "state",
      (by) => { viewer.featuresBy = by; viewer.recolour(); this._legend(); },
    );
    this.view = choice(Object.entries(VIEWS).map(([name, { title }]) => [name, title]), "orbit", (name) => this.chooseView(name));
    this.slab = element("input", {
      type: "number", min: "0", max: "1000", step: "0.1", value: "0",
      onchange: () => { viewer.views.thickness = Math.max(0, Number(this.slab.value) || 0); viewer.invalidate(); },
    });
    this.slabBack = button("◀", () => this.shiftSlab(-1), { "aria-label": "move the slab back" });
    this.slabOn = button("▶", () => this.shiftSlab(1), { "aria-label": "move the slab on" });
    this.measure = button("Measure", () => this.chooseMeasuring(!this.measuring), { "aria-pressed": "false" });
    this.search = element("input", {
      type: "text", list: "viewer-ids", size: "12", placeholder: "S1/L12",
      onchange: () => this._search(this.search.value.trim()),
    });
    const ids = viewer.stations.flatMap((own) => [...own.features.byId.keys()]);
    const datalist = element("datalist", { id: "viewer-ids" }, ...ids.slice(0, 5000).map((value) => element("option", { value })));
    this.toggles = Object.fromEntries(KINDS.map((kind) => [kind, toggle(
      KIND_TITLES[kind], viewer.visible[kind], (on) => { viewer.visible[kind] = on; viewer.applyVisibility(); },
    )]));
    const stations = viewer.stations.map((own) => toggle(
      own.station.name + (own.station.status === "unregistered" ? " (not registered)" : ""), true, (on) => {
        if (on) viewer.hidden.delete(own.station.name); else viewer.hidden.add(own.station.name);
        viewer.relayout();
      }, `#${own.colour.getHexString()}`,
    ));
    this.toolbar.append(
      element("div", { class: "viewer-row" }, labelled("show", this.scope), this.steps, this.alternatives,
        labelled("view", this.view), labelled("slab [m]", this.slab), this.slabBack, this.slabOn,
        button("All of it", () => viewer.views.fit())),
      element("div", { class: "viewer-row" }, labelled("points by", this.colouring), labelled("features by", this.featuresBy),
        this.measure, this.help.opener, labelled("find", this.search), datalist),
      element("fieldset", { class: "viewer-row" }, element("legend", { text: "shown" }), ...Object.values(this.toggles)),
      element("details", { class: "viewer-stations", open: stations.length < 9 },
        element("summary", { text: "Stations" }), element("div", { class: "viewer-row" }, ...stations)),
    );
    this.root.querySelector(".viewer-side").prepend(this.help.panel);
    viewer.applyVisibility();
  }

  choosePair(number) {
    const { viewer } = this;
    viewer.pair = number;
    viewer.alternative = 0;
    viewer.beside = null;
    this.scope.value = number === null ? "" : String(number);
    this.steps.hidden = number !== null;
    this.alternatives.hidden = number === null;
    const pair = viewer.currentPair;
    if (pair) {
      const options = pair.poses.map((pose, k) => [String(k), pose.title + (pose.score === null ? "" : ` (score ${pose.score.toFixed(2)})`)]);
      fill(this.alternative, options.length ? options : [["0", "no pose was found: as the files have them"]], "0");
      fill(this.beside, [["", "nothing"], ...options], "");
      const other = pair.poses.findIndex((pose) => pose.name === "runner-up");
      if (pair.status === "ambiguous" && other > 0) { viewer.beside = other; this.beside.value = String(other); }
    }
    this.help.pairChanged();
    viewer.resized();
    viewer.relayout();
    viewer.views.fit();
    this.chooseStage(viewer.stage);
    this._tellPair();
  }

  chooseStage(value) {
    const { viewer, data } = this;
    viewer.stage = value;
    this.step.value = String(value);
    const nearest = data.stages[Math.round(value)];
    this.stepTitle.textContent = nearest.title;
    this.step.setAttribute("aria-valuetext", nearest.title);
    viewer.relayout();
    this._legend();
  }

  chooseAlternative(number) {
    this.viewer.alternative = number;
    this.alternative.value = String(number);
    this.viewer.relayout();
    this._legend();
  }

  chooseBeside(number) {
    this.viewer.beside = number;
    this.beside.value = number === null ? "" : String(number);
    this.viewer.resized();
    this.viewer.relayout();
  }

  chooseColouring(mode) {
    this.viewer.colouring = mode;
    this.colouring.value = mode;
    this.viewer.recolour();
    this._legend();
  }

  chooseView(name) {
    this.viewer.views.show(name);
    this.view.value = name;
    this.slab.value = String(this.viewer.views.thickness);
    this.viewer.invalidate();
  }

  shiftSlab(direction) {
    this.viewer.views.shiftSlab(direction * (this.viewer.views.thickness || 1) / 2);
  }

  chooseMeasuring(on) {
    if (on) this.help.close();
    this.measuring = on;
    this.measured = [];
    this.measure.setAttribute("aria-pressed", String(on));
    this.viewer.setMarks([]);
    this._cross();
    if (on) this.say("Choose two points: click on them, or bring each under the cross with the arrow keys and press X.");
    else this.say("");
  }

  _cross() { this.cross.classList.toggle("viewer-on", this.measuring || this.help.picking); }

  // --- what the picture is asked for

  _listen() {
    const { canvas } = this;
    let down = null;
    canvas.addEventListener("pointerdown", (event) => { down = [event.offsetX, event.offsetY]; canvas.focus({ preventScroll: true }); });
    canvas.addEventListener("pointerup", (event) => {
      if (!down || Math.hypot(event.offsetX - down[0], event.offsetY - down[1]) > 4 || event.button !== 0) return;
      this.take(event.offsetX, event.offsetY);
    });
    canvas.addEventListener("keydown", (event) => this._key(event));
    this._nameRows();
    document.addEventListener("click", (event) => this._row(event));
    document.addEventListener("keydown", (event) => {
      if (event.key === "Enter" || event.key === " ") this._row(event);
    });
  }

  // Rows of the page that name pairs by number and stations by name become rows of the viewer.
  _nameRows() {
    for (const row of document.querySelectorAll("tr[data-pair], tr[data-station]")) {
      const pair = this.data.pairs[Number(row.dataset.pair)];
      if (row.dataset.station === undefined && !pair) continue;
      row.dataset.feature ??= row.dataset.station === undefined ? `pair/${pair.target}/${pair.source}` : `station/${row.dataset.station}`;
      row.tabIndex = 0;
    }
  }

  _row(event) {
    if (!(event.target instanceof Element) || event.target.closest("a, button, input, select, summary, .viewer-picture")) return;
    const row = event.target.closest("[data-feature]");
    if (!row) return;
    if (event.type === "keydown") event.preventDefault();
    this.selectById(row.dataset.feature);
  }

  // Show what a table speaks of: a feature, a station, a pair or a piece of one.
  selectById(id) {
    const parts = id.split("/");
    if (parts[0] === "pair" || parts[0] === "unexplained") {
      const number = this.data.pairs.findIndex((pair) => pair.target === parts[1] && pair.source === parts[2]);
      if (number >= 0 && this.viewer.pair !== number) this.choosePair(number);
      if (parts[0] === "pair") { this._highlightRows(id); return; }
    } else if (this.viewer.currentPair) {
      const own = this.viewer.find(id)?.own;
      const { target, source } = this.viewer.currentPair;
      if (own && ![target, source].includes(own.station.name)) this.choosePair(null);
    }
    this.viewer.select(id, { look: true });
    this._syncToggles();
  }

  _search(id) {
    if (!id) return;
    if (this.viewer.find(id)) this.selectById(id);
    else this.say(`There is no feature ${id}.`);
  }

  _syncToggles() {
    for (const [kind, label] of Object.entries(this.toggles)) label.querySelector("input").checked = this.viewer.visible[kind];
  }

  // A click, or the key at the cross.
  take(x, y) {
    if (this.measuring || this.help.picking) {
      const found = this.viewer.pointAt(x, y);
      if (!found) { this.say("There is no point here; zoom in, or try beside it."); return; }
      if (this.help.picking) this.help.take(found);
      else this._measured(found);
      return;
    }
    const id = this.viewer.featureAt(x, y);
    if (id) { this.viewer.select(id); this._syncToggles(); return; }
    this.viewer.select(null);
    const found = this.viewer.pointAt(x, y);
    if (found) this._tellPoint(found);
  }

  // Distance between two marks ({station, point}) and its standard deviation, where the stations lie now.
  distance(marks) { return distanceWithStd(...marks.map((mark) => this.viewer.end(mark))); }

  _measured(found) {
    if (this.measured.length === 2) this.measured = [];
    this.measured.push(found);
    const marks = this.measured.map((mark, k) => ({ ...mark, text: "AB"[k] }));
    this.viewer.setMarks(marks, marks.length === 2 ? [marks] : []);
    if (marks.length < 2) { this.say(`A: a point of ${found.station}. Choose the second point.`); return; }
    const { distance_m: distance, std_m: std, difference } = this.distance(marks);
    const same = marks[0].station === marks[1].station;
    this._tell("Distance", [
      ["A, B", `${marks[0].station}, ${marks[1].station}`],
      ["distance", `${distance.toFixed(4)} m`],
      ["standard deviation", std === null ? "not known: a pose has no covariance" : metres(std)],
      ["horizontal, vertical", `${Math.hypot(difference[0], difference[1]).toFixed(4)} m, ${difference[2].toFixed(4)} m`],
      ["made of", same ? "the noise of the scan at both ends; its pose moves both alike"
        : "the poses of both stations, taken as independent, and the noise of the scans at both ends"],
    ]);
    this.say(`Distance ${distance.toFixed(4)} m, standard deviation ${std === null ? "not known" : metres(std)}.`);
  }

  _key(event) {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const { views } = this.viewer;
    const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
    const names = Object.keys(VIEWS);
    const { key } = event;
    if (arrows[key]) views.step(...arrows[key], event.shiftKey);
    else if (key === "+" || key === "=") views.zoom(1.2);
    else if (key === "-") views.zoom(1 / 1.2);
    else if (key >= "1" && key <= "4") this.chooseView(names[Number(key) - 1]);
    else if (key === "0") views.fit();
    else if (key === "[") this.shiftSlab(-1);
    else if (key === "]") this.shiftSlab(1);
    else if (key === "c" || key === "C") this._next(this.colouring, (mode) => this.chooseColouring(mode));
    else if (key === "b" || key === "B") this._beforeAfter();
    else if (key === "a" || key === "A") { if (this.viewer.currentPair) this._next(this.alternative, (k) => this.chooseAlternative(Number(k))); }
    else if (key === "m" || key === "M") this.chooseMeasuring(!this.measuring);
    else if (key === "x" || key === "X" || key === "Enter") {
      const wide = this.viewer.beside === null ? 1 : 2;
      this.take(this.canvas.clientWidth / 2 / wide, this.canvas.clientHeight / 2);
    } else if (key === "Backspace") {
      if (this.help.picking) this.help.takeBack();
      else if (this.measuring) { this.measured.pop(); this.viewer.setMarks(this.measured.map((mark, k) => ({ ...mark, text: "AB"[k] }))); }
    } else if (key === "Escape") {
      if (this.help.picking) this.help.close();
      else if (this.measuring) this.chooseMeasuring(false);
      else this.viewer.select(null);
    } else return;
    event.preventDefault();
  }

  _next(select, choose) {
    const values = [...select.options].map((option) => option.value);
    choose(values[(values.indexOf(select.value) + 1) % values.length]);
  }

  _beforeAfter() {
    if (this.viewer.currentPair) return;
    const last = this.data.stages.length - 1;
    this.chooseStage(this.viewer.stage === last ? 0 : last);
  }

  // --- what is said

  _tell(title, rows, paragraphs = []) {
    this.info.replaceChildren(
      element("h3", { text: title }),
      element("dl", {}, ...rows.flatMap(([name, value]) => [element("dt", { text: name }), element("dd", { text: String(value) })])),
      ...(paragraphs.length ? [element("ul", {}, ...paragraphs.map((text) => element("li", { text })))] : []),
    );
  }

  _tellPoint({ station, point }) {
    const own = this.viewer.byName.get(station);
    const world = this.viewer.end({ station, point }).pose;
    const at = world.slice(0, 3).map((row) => row[0] * point[0] + row[1] * point[1] + row[2] * point[2] + row[3]);
    this._tell(`Point of ${station}`, [
      [this.viewer.currentPair ? `in the frame of ${this.viewer.currentPair.target} [m]` : "world [m]", at.map((value) => value.toFixed(4)).join(", ")],
      ["file [m]", point.map((value) => value.toFixed(4)).join(", ")],
      ["noise of the scan", metres(own.station.noise_std_m)],
    ]);
  }

  _tellPair() {
    const pair = this.viewer.currentPair;
    if (!pair) { this.info.replaceChildren(); return; }
    const rows = pair.unexplained.map((piece, k) => [`unexplained/${pair.target}/${pair.source}/${k}`, `${piece.area_m2.toFixed(2)} m² of `
      + `${piece.station} stand where the other instrument looked through, ${piece.range_m.toFixed(1)} m from it`]);
    this._tell(`Pair ${pair.target} – ${pair.source}`, [
      ["status", pair.status],
      ["poses", pair.poses.map((pose) => pose.title).join("; ") || "none"],
      ["lines and planes in common", pair.correspondences.length],
    ], [...pair.reasons, ...pair.weak_directions]);
    if (rows.length) this.info.append(table("What speaks against it", ["piece of surface"], rows, true));
    const matched = pair.correspondences.map(([target, source, state]) => [target, target, source, state]);
    matched.sort((a, b) => (b[3] === "removed") - (a[3] === "removed"));
    if (matched.length) this.info.append(table("Lines and planes in common", [pair.target, pair.source, "state"], matched.slice(0, MOST_ROWS), false));
  }

  _selected(id) {
    this._highlightRows(id);
    if (!id) { this._tellPair(); return; }
    const found = this.viewer.find(id);
    if (found?.piece) {
      const { piece } = found.piece.userData;
      this._tell("Piece that speaks against the pair", [
        ["station", piece.station], ["area", `${piece.area_m2.toFixed(3)} m²`],
        ["seen through from", `${piece.range_m.toFixed(2)} m`],
      ]);
    } else if (found) {
      const { feature, kind } = found;
      const partners = this.data.pairs.flatMap((pair) => pair.correspondences)
        .filter(([target, source]) => target === id || source === id)
        .map(([target, source, state]) => `${target === id ? source : target} (${state})`);
      const rows = [];
      if (feature.source) rows.push(["from", feature.source]);
      if (feature.state) rows.push(["state", feature.state]);
      if (feature.ratio !== null && feature.ratio !== undefined) rows.push(["largest test value over its limit", feature.ratio.toFixed(2)]);
      if (kind === "lines" || kind === "edges") rows.push(["length", `${Math.hypot(...feature.end_m.map((value, k) => value - feature.start_m[k])).toFixed(3)} m`]);
      if (feature.radius_m) rows.push(["radius", `${feature.radius_m.toFixed(4)} m`]);
      if (partners.length) rows.push(["taken for the same", partners.join(", ")]);
      if (found.own.station.reason) rows.push(["not registered", found.own.station.reason]);
      this._tell(id, rows);
    }
  }

  _highlightRows(id) {
    let first = null;
    for (const row of document.querySelectorAll("[data-feature]")) {
      const isChosen = row.dataset.feature === id;
      row.classList.toggle("viewer-selected", isChosen);
      if (isChosen) { row.setAttribute("aria-current", "true"); first ??= row; } else row.removeAttribute("aria-current");
    }
    if (first && !first.contains(document.activeElement)) first.scrollIntoView({ block: "nearest" });
  }

  _legend() {
    const { viewer } = this;
    const ramp = (low, high) => element("div", { class: "viewer-ramp" }, element("span", { text: low }), element("span", { class: "viewer-bar" }), element("span", { text: high }));
    const parts = [];
    if (viewer.colouring === "height") {
      const { min, max } = viewer.views.box;
      parts.push(element("p", { text: "Height" }), ramp(`${(min.z + viewer.base[2]).toFixed(2)} m`, `${(max.z + viewer.base[2]).toFixed(2)} m`));
    }
    if (viewer.colouring === "std") {
      parts.push(element("p", { text: "Standard deviation of position, all directions together" }));
      if (viewer.stdLimits) parts.push(ramp(metres(viewer.stdLimits[0]), metres(viewer.stdLimits[1])));
      parts.push(element("p", { text: "Grey: not known at this step." }));
    }
    const keys = {
      state: [["used", "used"], ["not-controlled", "not controlled"], ["removed", "removed"], ["alone", "in no accepted pair"]],
      residual: [["used", "fits well"], ["removed", "at its limit or beyond"], ["alone", "not tested"]],
      station: [],
    }[viewer.featuresBy];
    if (keys.length) {
      parts.push(element("p", { class: "viewer-states" }, ...keys.flatMap(([state, text]) => [
        element("span", { class: `viewer-chip viewer-${state}` }), document.createTextNode(`${text} `),
      ])));
    }
    this.legend.replaceChildren(...parts);
  }
}

// A list whose rows show what they speak of: the first member of each is its feature.
function table(title, heads, rows, open) {
  return element("details", { open }, element("summary", { text: title }), element(
    "table", {}, element("thead", {}, element("tr", {}, ...heads.map((text) => element("th", { scope: "col", text })))),
    element("tbody", {}, ...rows.map(([id, ...cells]) => element(
      "tr", { "data-feature": id, tabindex: "0" }, ...cells.map((text) => element("td", { text })),
    ))),
  ));
}

// Where the service lies: it may have a path before its own behind a proxy.
function base() {
  const script = document.querySelector('script[src$="/static/viewer.js"]');
  return script ? new URL(script.src).pathname.replace(/\/static\/viewer\.js$/, "") : "";
}

// The page may leave the style sheet to the viewer: it lies beside the script.
function addStyle() {
  if (document.querySelector('link[href$="viewer.css"]')) return;
  const script = document.querySelector('script[src$="viewer.js"]');
  const href = script ? script.src.replace(/viewer\.js$/, "viewer.css") : "/static/viewer.css";
  document.head.append(element("link", { rel: "stylesheet", href }));
}

const root = document.getElementById("viewer");
if (root?.dataset.job) {
  addStyle();
  const application = new Application(root);
  window.tielineViewer = application; // for tests, and for whoever is curious
  application.start();
}
