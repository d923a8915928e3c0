// Put the viewer into the page: <div id="viewer" data-job="..."> gets a picture, its controls, and what is said of both.

import { MISS_TIMES } from "./features.js";
import { ManualHelp } from "./manual_help.js";
import { button, choice, element, fill, keyTable, labelled, metres, toggle } from "./panel.js";
import { added, cross, distanceWithStd, norm, subtracted } from "./poses.js";
import { REACH_M } from "./residuals.js";
import { foundTargets } from "./targets.js";
import { KINDS, Viewer } from "./viewer.js";
import { VIEWS } from "./views.js";
import { decimal, t, word } from "./words.js";

const COLOURINGS = ["deviation", "station", "intensity", "rgb", "height", "std", "residual"];

const MOST_ROWS = 500;

class Application {
  constructor(root) {
    this.root = root;
    this.job = root.dataset.job;
    this.measuring = false;
    this.measured = [];
    this.status = element("p", { class: "viewer-status", role: "status", "aria-live": "polite", text: t("loading") });
    root.classList.add("viewer");
    root.append(this.status);
  }

  get base() { return base(); }

  get here() { return `${base()}/jobs/${encodeURIComponent(this.job)}`; }

  say(text) { if (this.status.textContent !== text) this.status.textContent = text; }

  async start() {
    let answer;
    try {
      answer = await fetch(`${this.here}/scene${this.root.dataset.part ?? ""}`, { credentials: "same-origin", headers: { Accept: "application/json" } });
    } catch {
      this.say(t("unreachable"));
      return;
    }
    if (!answer.ok) {
      const problem = await answer.json().catch(() => ({}));
      this.say(problem.detail ?? problem.title ?? t("nothing", { status: answer.status }));
      return;
    }
    this.data = await answer.json();
    for (const cloud of this.data.clouds) if (cloud.href) cloud.href = base() + cloud.href;
    this._build();
  }

  _build() {
    const { data } = this;
    this.canvas = element("canvas", {
      tabindex: "0", role: "application", "aria-label": t("picture"),
    });
    this.cross = element("div", { class: "viewer-cross", "aria-hidden": "true" });
    this.picture = element("div", { class: "viewer-picture" }, this.canvas, this.cross);
    this.info = element("div", { class: "viewer-info", "aria-live": "polite" });
    this.legend = element("div", { class: "viewer-legend" });
    this.lists = element("div");
    this.toolbar = element("div", { class: "viewer-tools", role: "group", "aria-label": t("tools") });
    this.root.append(this.toolbar, element("div", { class: "viewer-body" }, this.picture, element(
      "div", { class: "viewer-side" }, this.legend, this.info, this.lists,
    )), keyTable());
    try {
      this.viewer = new Viewer(this.canvas, data, {
        changed: () => this._drawn(),
        failed: (error) => this.say(error.message),
        selected: (id) => this._selected(id),
        first: (ms, bytes) => this._first(ms, bytes),
        measured: () => this._legend(),
      });
    } catch (error) {
      this.say(t("no_webgl", { why: error.message }));
      return;
    }
    this.help = new ManualHelp(this);
    this._tools();
    this._listen();
    this.choosePair(data.stations.length === 2 && data.pairs[0]?.status !== "accepted" && data.pairs.length ? 0 : null);
    const gone = data.clouds.filter((cloud) => !cloud.href).map((cloud) => cloud.station);
    this.say(gone.length ? t("gone", { names: gone.join(", ") }) : t("loading_points"));
    this._list();
  }

  _first(ms, bytes) {
    this.root.dataset.firstPictureMs = ms.toFixed(0);
    this.root.dataset.firstPictureBytes = String(bytes);
    if (this.status.textContent === t("loading_points")) this.say("");
    if (this.data.deviations) return; // a comparison registers no scan
    foundTargets(base(), this.job).then((found) => this._showTargets(found), () => {}); // what is shown does without them
  }

  _drawn() {
    this.root.dataset.points = String(this.viewer.detail.shown);
    this.root.dataset.loading = String(this.viewer.detail.loading + (this.viewer.isMoving ? 1 : 0) + (this.viewer.isMeasuring ? 1 : 0));
  }

  // --- controls

  _tools() {
    const { data, viewer } = this;
    const pairs = data.pairs.map((pair, k) => [String(k), `${t("pair", pair)}: ${word("status", pair.status)}`]);
    this.scope = choice([["", t("all_stations")], ...pairs], "", (value) => this.choosePair(value === "" ? null : Number(value)));
    this.step = element("input", {
      type: "range", min: "0", max: String(data.stages.length - 1), step: "0.05", value: String(data.stages.length - 1),
      oninput: () => this.chooseStage(Number(this.step.value)),
    });
    this.stepTitle = element("output");
    this.steps = element("span", { class: "viewer-group" }, labelled(t("before_after"), this.step), this.stepTitle);
    this.alternative = choice([], "", (value) => this.chooseAlternative(Number(value)));
    this.beside = choice([], "", (value) => this.chooseBeside(value === "" ? null : Number(value)));
    this.alternatives = element(
      "span", { class: "viewer-group" }, labelled(t("pose"), this.alternative), labelled(t("beside"), this.beside),
    );
    this.colouring = choice(
      COLOURINGS.filter((mode) => viewer.can(mode)).map((mode) => [mode, t(`colours.${mode}`)]), viewer.colouring, (mode) => this.chooseColouring(mode),
    );
    this.featuresBy = choice(
      ["state", "residual", "station"].map((by) => [by, t(`by.${by}`)]), "state",
      (by) => { viewer.featuresBy = by; viewer.recolour(); this._legend(); },
    );
    this.view = choice(Object.keys(VIEWS).map((name) => [name, t(`views.${name}`)]), "orbit", (name) => this.chooseView(name));
    this.slab = element("input", {
      type: "number", min: "0", max: "1000", step: "0.1", value: "0",
      onchange: () => { viewer.views.thickness = Math.max(0, Number(this.slab.value) || 0); viewer.invalidate(); },
    });
    this.slabBack = button("◀", () => this.shiftSlab(-1), { "aria-label": t("slab_back") });
    this.slabOn = button("▶", () => this.shiftSlab(1), { "aria-label": t("slab_on") });
    this.measure = button(t("measure"), () => this.chooseMeasuring(!this.measuring), { "aria-pressed": "false" });
    this.search = element("input", {
      type: "text", list: "viewer-ids", size: "12", placeholder: "S1/L12",
      onchange: () => this._search(this.search.value.trim()),
    });
    const ids = viewer.stations.flatMap((own) => [...own.features.byId.keys()]);
    const datalist = element("datalist", { id: "viewer-ids" }, ...ids.slice(0, 5000).map((value) => element("option", { value })));
    this.toggles = Object.fromEntries(KINDS.map((kind) => [kind, toggle(
      t(`kinds.${kind}`), viewer.visible[kind], (on) => { viewer.visible[kind] = on; viewer.applyVisibility(); },
    )]));
    const stations = viewer.stations.map((own) => toggle(
      own.station.name + (own.station.status === "unregistered" ? ` (${word("station", "unregistered")})` : ""), true, (on) => {
        if (on) viewer.hidden.delete(own.station.name); else viewer.hidden.add(own.station.name);
        viewer.relayout();
      }, `#${own.colour.getHexString()}`,
    ));
    this.toolbar.append(
      element("div", { class: "viewer-row" }, labelled(t("show"), this.scope), this.steps, this.alternatives,
        labelled(t("view"), this.view), labelled(t("slab"), this.slab), this.slabBack, this.slabOn,
        button(t("all_of_it"), () => viewer.views.fit())),
      element("div", { class: "viewer-row" }, labelled(t("points_by"), this.colouring), labelled(t("features_by"), this.featuresBy),
        this.measure, this.help.opener, labelled(t("find"), this.search), datalist),
      element("fieldset", { class: "viewer-row" }, element("legend", { text: t("shown") }), ...Object.values(this.toggles)),
      element("details", { class: "viewer-stations", open: stations.length < 9 },
        element("summary", { text: t("stations") }), element("div", { class: "viewer-row" }, ...stations)),
    );
    this.toggles.targets.hidden = !data.stations.some((station) => station.targets?.length); // until there are some
    this.toggles.control.hidden = !data.control?.length;
    if (data.deviations) { // there are points, and nothing that was found in them
      this.help.opener.hidden = true;
      for (const field of [this.scope, this.featuresBy, this.search]) field.parentElement.hidden = true;
      for (const kind of KINDS) this.toggles[kind].hidden = kind !== "points";
    }
    this.root.querySelector(".viewer-side").prepend(this.help.panel);
    viewer.applyVisibility();
  }

  choosePair(number) {
    const { viewer } = this;
    viewer.pair = number;
    viewer.alternative = 0;
    viewer.beside = null;
    this.scope.value = number === null ? "" : String(number);
    this.steps.hidden = number !== null || this.data.stages.length < 2;
    this.alternatives.hidden = number === null;
    const pair = viewer.currentPair;
    if (pair) {
      const options = pair.poses.map((pose, k) => [String(k), pose.score === null ? t(`poses.${pose.name}`)
        : t("score", { title: t(`poses.${pose.name}`), score: decimal(pose.score, 2) })]);
      fill(this.alternative, options.length ? options : [["0", t("no_pose")]], "0");
      fill(this.beside, [["", t("nothing_beside")], ...options], "");
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
    this.stepTitle.textContent = t(`stages.${nearest.name}`);
    this.step.setAttribute("aria-valuetext", this.stepTitle.textContent);
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
    if (on) this.say(t("measuring.choose"));
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
    for (const row of document.querySelectorAll("tr[data-control]")) {
      if (!this.viewer.find(`control/${row.dataset.control}`)) continue;
      row.dataset.feature ??= `control/${row.dataset.control}`;
      row.tabIndex = 0;
    }
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
    } else if (parts[0] === "control") {
      if (this.viewer.currentPair) this.choosePair(null);
      this.chooseStage(this.data.stages.length - 1);
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
    const found = [id, `target/${id}`, `control/${id}`].find((each) => this.viewer.find(each));
    if (found) this.selectById(found);
    else this.say(t("not_found", { id }));
  }

  _syncToggles() {
    for (const [kind, label] of Object.entries(this.toggles)) label.querySelector("input").checked = this.viewer.visible[kind];
  }

  // A click, or the key at the cross.
  take(x, y) {
    if (this.measuring || this.help.picking) {
      const found = this.viewer.pointAt(x, y);
      if (!found) { this.say(t("measuring.no_point")); return; }
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
    if (marks.length < 2) { this.say(t("measuring.first", { station: found.station })); return; }
    const { distance_m: distance, std_m: std, difference } = this.distance(marks);
    const same = marks[0].station === marks[1].station;
    const known = std === null ? null : metres(std);
    this._tell(t("measuring.title"), [
      ["A, B", `${marks[0].station}, ${marks[1].station}`],
      [t("measuring.distance"), `${decimal(distance, 4)} m`],
      [t("measuring.std"), known ?? t("measuring.no_std")],
      [t("measuring.parts"), `${decimal(Math.hypot(difference[0], difference[1]), 4)} m, ${decimal(difference[2], 4)} m`],
      [t("measuring.made_of"), t(same ? "measuring.same" : "measuring.other")],
    ]);
    this.say(t("measuring.said", { distance: `${decimal(distance, 4)} m`, std: known ?? t("measuring.unknown") }));
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
    const { currentPair: pair } = this.viewer;
    const written = (place) => place.map((value) => decimal(value, 4)).join("; ");
    this._tell(t("tell.point", { station }), [
      [pair ? t("tell.in_frame", { station: pair.target }) : t("tell.world"), written(at)],
      [t("tell.file"), written(point)],
      ...(own.station.noise_std_m === null ? [] : [[t("tell.noise"), metres(own.station.noise_std_m)]]),
    ]);
  }

  _tellPair() {
    const pair = this.viewer.currentPair;
    if (!pair) { this.info.replaceChildren(); return; }
    const rows = pair.unexplained.map((piece, k) => [`unexplained/${pair.target}/${pair.source}/${k}`, t("tell.piece_row", {
      area: decimal(piece.area_m2, 2), station: piece.station, range: decimal(piece.range_m, 1),
    })]);
    this._tell(t("tell.pair", pair), [
      [t("tell.status"), word("status", pair.status)],
      [t("tell.poses"), pair.poses.map((pose) => t(`poses.${pose.name}`)).join("; ") || t("tell.none")],
      [t("tell.common"), pair.correspondences.length],
    ], [...pair.reasons, ...pair.weak_directions]);
    if (rows.length) this.info.append(table(t("tell.against"), [t("tell.piece_head")], rows, true));
    const matched = pair.correspondences.map(([target, source, state]) => [target, target, source, word("feature", state), state]);
    matched.sort((a, b) => (b[4] === "removed") - (a[4] === "removed"));
    if (matched.length) {
      this.info.append(table(
        t("tell.common_title"), [pair.target, pair.source, t("tell.state")],
        matched.slice(0, MOST_ROWS).map((row) => row.slice(0, 4)), false,
      ));
    }
  }

  // Everything that was found, as rows that show what they speak of.
  _list() {
    if (this.data.deviations) return;
    const features = this.viewer.stations.flatMap((own) => [...own.features.byId.values()])
      .filter(({ kind }) => kind !== "instruments");
    features.sort((a, b) => (b.feature.ratio ?? -1) - (a.feature.ratio ?? -1));
    const rows = features.slice(0, MOST_ROWS).map(({ kind, feature }) => [
      feature.id, kind === "targets" ? feature.id.slice("target/".length) : feature.id, kind === "targets" ? t(`targets.${feature.kind}`) : t(`kinds.${kind}`), sizeOf(feature),
      feature.state ? word(kind === "targets" ? "point-state" : "feature", feature.state) : "",
      feature.ratio === null || feature.ratio === undefined ? "" : decimal(feature.ratio, 2),
    ]);
    for (const point of this.data.control ?? []) {
      rows.push([point.id, point.name, word("use", point.use), "", word("point-state", point.state),
        point.statistic === null ? "" : decimal(point.statistic / point.critical, 2)]);
    }
    const list = table(t("tell.features"), [
      t("tell.feature"), t("tell.kind"), t("tell.size"), t("tell.state"), t("tell.ratio"),
    ], rows, false);
    if (features.length > rows.length) {
      list.append(element("p", { text: t("tell.more", { shown: rows.length, all: features.length }) }));
    }
    this.lists.replaceChildren(list);
  }

  _showTargets(found) {
    if (![...found.values()].some((targets) => targets.length)) return;
    for (const [name, targets] of found) {
      const own = this.viewer.byName.get(name);
      if (own && !own.station.targets?.length) own.features.addTargets(targets); // else those that took part are shown
    }
    this.toggles.targets.hidden = false;
    this._list();
    this.viewer.recolour();
  }

  _selected(id) {
    this._highlightRows(id);
    if (!id) { this._tellPair(); return; }
    const found = this.viewer.find(id);
    if (found?.known) {
      const { point } = found.known.userData;
      this._tell(point.name, [
        [t("tell.kind"), word("use", point.use)],
        [t("tell.state"), word("point-state", point.state)],
        [t("tell.world"), point.known_m.map((value) => decimal(value, 4)).join("; ")],
        ...(point.difference_m ? [[t("tell.miss"), point.difference_m.map(metres).join("; ")]] : []),
        ...(point.statistic === null ? [] : [[t("tell.test"), `${decimal(point.statistic, 1)}; ${decimal(point.critical, 1)}`]]),
        ...(point.stations.length ? [[t("tell.seen_by"), point.stations.join(", ")]] : []),
      ]);
    } else if (found?.piece) {
      const { piece } = found.piece.userData;
      this._tell(t("tell.piece"), [
        [t("tell.station"), piece.station], [t("tell.area"), `${decimal(piece.area_m2, 3)} m²`],
        [t("tell.seen_through"), `${decimal(piece.range_m, 2)} m`],
      ]);
    } else if (found) {
      const { feature, kind } = found;
      const partners = this.data.pairs.flatMap((pair) => pair.correspondences)
        .filter(([target, source]) => target === id || source === id)
        .map(([target, source, state]) => `${target === id ? source : target} (${word("feature", state)})`);
      const rows = [];
      if (feature.source) rows.push([t("tell.from"), word("source", feature.source)]);
      if (feature.state) rows.push([t("tell.state"), word(kind === "targets" ? "point-state" : "feature", feature.state)]);
      if (feature.ratio !== null && feature.ratio !== undefined) rows.push([t("tell.ratio"), decimal(feature.ratio, 2)]);
      if (kind === "lines" || kind === "edges") rows.push([t("tell.length"), sizeOf(feature)]);
      if (feature.radius_m) rows.push([t("tell.radius"), `${decimal(feature.radius_m, 4)} m`]);
      if (kind === "targets") {
        rows.push([t("tell.kind"), t(`targets.${feature.kind}`)]);
        rows.push([t("tell.file"), feature.centre_m.map((value) => decimal(value, 4)).join("; ")]);
        if (feature.std_m) rows.push([t("tell.coordinates_std"), feature.std_m.map(metres).join("; ")]);
        if (feature.residual_m) rows.push([t("tell.target_residual"), feature.residual_m.map(metres).join("; ")]);
      }
      if (partners.length) rows.push([t("tell.partners"), partners.join(", ")]);
      if (found.own.station.reason) rows.push([t("tell.why_not"), found.own.station.reason]);
      this._tell(kind === "targets" ? id.slice("target/".length) : id, rows);
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
    const { deviations } = this.data;
    if (viewer.colouring === "deviation") {
      const millimetres = (value) => `${value > 0 ? "+" : ""}${decimal(1000 * value, 1)} mm`;
      const chip = (rgb) => {
        const made = element("span", { class: "viewer-chip" });
        made.style.backgroundColor = `rgb(${rgb.join(" ")})`;
        return made;
      };
      const [low, high] = [deviations.limits_m[0], deviations.limits_m.at(-1)];
      parts.push(element("p", { text: t("legend.deviation") }));
      parts.push(element("div", { class: "viewer-ramp" }, element("span", { text: `≤ ${millimetres(low)}` }),
        element("span", { class: "viewer-classes" }, ...deviations.colours.map(chip)), element("span", { text: `> ${millimetres(high)}` })));
      if (deviations.sign_is_arbitrary) parts.push(element("p", { text: t("legend.arbitrary_sign") }));
      for (const name of ["insignificant", "without"]) {
        if (deviations[name]) parts.push(element("p", {}, chip(deviations[name]), document.createTextNode(t(`legend.${name}`))));
      }
    }
    if (viewer.colouring === "height") {
      const { min, max } = viewer.views.box;
      parts.push(element("p", { text: t("legend.height") }), ramp(`${decimal(min.z + viewer.base[2], 2)} m`, `${decimal(max.z + viewer.base[2], 2)} m`));
    }
    if (viewer.colouring === "std") {
      parts.push(element("p", { text: t("legend.std") }));
      if (viewer.stdLimits) parts.push(ramp(metres(viewer.stdLimits[0]), metres(viewer.stdLimits[1])));
      parts.push(element("p", { text: t("legend.unknown") }));
    }
    if (viewer.colouring === "residual") {
      const { median } = viewer.residuals;
      parts.push(element("p", { text: t("legend.residual", { reach: metres(REACH_M) }) }));
      parts.push(ramp("0", metres(viewer.shared.largestResidual.value)));
      parts.push(element("p", { text: t("legend.no_plane", { median: median === null ? "–" : metres(median) }) }));
    }
    const keys = {
      state: ["used", "not-controlled", "removed", "alone"].map((state) => [state, t(`legend.${state}`)]),
      residual: [["used", t("legend.fits")], ["removed", t("legend.at_limit")], ["alone", t("legend.untested")]],
      station: [],
    }[viewer.featuresBy];
    if (keys.length && !deviations) {
      parts.push(element("p", { class: "viewer-states" }, ...keys.flatMap(([state, text]) => [
        element("span", { class: `viewer-chip viewer-${state}` }), document.createTextNode(`${text} `),
      ])));
    }
    if (this.data.control?.length) parts.push(element("p", { text: t("legend.misses", { times: MISS_TIMES }) }));
    this.legend.replaceChildren(...parts);
  }
}

// How large a feature is: length, radius, area of its outline; nothing for targets.
function sizeOf(feature) {
  if (feature.radius_m) return `r ${decimal(feature.radius_m, 3)} m`;
  if (feature.end_m) return `${decimal(Math.hypot(...feature.end_m.map((value, k) => value - feature.start_m[k])), 3)} m`;
  if (!feature.boundary_m) return "";
  const [first, ...others] = feature.boundary_m;
  const sides = others.map((corner) => subtracted(corner, first));
  const doubled = sides.slice(1).reduce((sum, side, k) => added(sum, cross(sides[k], side)), [0, 0, 0]);
  return `${decimal(norm(doubled) / 2, 2)} m²`;
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
