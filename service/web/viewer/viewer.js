// The viewer of one job: points of all stations, what was found in them, and how they came to lie.

import * as THREE from "three";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";
import { Cloud, COLOUR_MODES, sharedUniforms } from "./cloud.js";
import { Detail, pointOnRay } from "./detail.js";
import { controlMark, lineMaterial, lineMaterials, SELECTED, StationFeatures, textSprite } from "./features.js";
import * as poses from "./poses.js";
import { REACH_M, Residuals } from "./residuals.js";
import { Views } from "./views.js";

THREE.ColorManagement.enabled = false; // colours are what they are in the files

const PICK_PX = 6;
const REST_MS = 200;
const RESIDUALS_MS = 40; // between two pictures
const MOST_PIECES = 200;
export const KINDS = ["points", "lines", "edges", "planes", "cylinders", "targets", "control", "instruments", "pieces"];

const matrix4 = (pose) => new THREE.Matrix4().set(...pose.flat());

export class Viewer {
  constructor(canvas, scene, listeners) {
    this.canvas = canvas;
    this.data = scene;
    this.listeners = listeners; // changed(), failed(error), selected(id), first(ms, bytes)
    // four samples a pixel would more than double the time of a picture of points, and do little for them
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: false, preserveDrawingBuffer: true });
    this.renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
    this.renderer.setClearColor(0x12171c);
    this.scene = new THREE.Scene();
    this.shared = sharedUniforms();
    this.views = new Views(canvas, () => this._moved());
    this.visible = { points: true, lines: true, edges: true, planes: false, cylinders: true, targets: true, control: true, instruments: true, pieces: true };
    this.hidden = new Set(); // stations
    this.only = null; // a station that is shown alone while points are picked in it
    this.featuresBy = "state";
    this.colouring = "station";
    this.pair = null; // number of the pair that is looked at; null: all stations
    this.stage = scene.stages.length - 1;
    this.alternative = 0;
    this.beside = null; // number of the alternative that is shown to the right
    this.selected = null;
    this._build();
    this.relayout();
    this.views.fit();
    new ResizeObserver(() => this._resize()).observe(canvas.parentElement);
    this._resize();
  }

  _build() {
    const { stations, clouds } = this.data;
    const first = stations[0];
    const middle = (station) => station.bounds_m[0].map((low, axis) => (low + station.bounds_m[1][axis]) / 2);
    this.origin = poses.applied(first.world_from_scan ?? poses.IDENTITY, middle(first)).map(Math.round);
    this.stations = stations.map((station, number) => {
      const colour = new THREE.Color().setHSL((0.58 + number * 0.618034) % 1, 0.65, 0.62);
      const own = { station, colour, middle: middle(station), outline: outline(station), group: new THREE.Group() };
      own.cloud = new Cloud(clouds[number], colour, own.middle, this.shared);
      own.features = new StationFeatures(station, own.middle, colour);
      own.group.add(own.cloud.group, ...Object.values(own.features.groups));
      own.group.matrixAutoUpdate = false;
      this.scene.add(own.group);
      return own;
    });
    this.byName = new Map(this.stations.map((own) => [own.station.name, own]));
    this.evidence = new THREE.Group();
    this.marks = new THREE.Group();
    this.control = new THREE.Group();
    for (const point of this.data.control ?? []) {
      const mark = controlMark(point, point.place_m && poses.subtracted(point.place_m, point.known_m));
      mark.userData.point = point;
      this.control.add(mark);
    }
    this.scene.add(this.evidence, this.marks, this.control);
    const colouring = ["rgb", "intensity"].find((mode) => this.can(mode));
    if (colouring === "rgb" && this.stations.length < 2) this.colouring = "rgb";
    if (this.data.deviations) this.colouring = "deviation";
    this.detail = new Detail(
      this.stations.map((own) => own.cloud), () => this._loaded(), (error) => this.listeners.failed(error),
    );
    this.residuals = new Residuals(this.stations);
    this.recolour();
  }

  can(mode) {
    if (mode === "deviation") return Boolean(this.data.deviations);
    if (this.data.deviations) return mode === "height";
    if (mode === "residual") return this.stations.length > 1;
    if (mode === "rgb") return this.stations.some((own) => own.cloud.hasColour);
    if (mode === "intensity") return this.stations.some((own) => own.cloud.hasIntensity);
    if (mode === "std") return this.data.stations.some((station) => station.covariance);
    return true;
  }

  // --- where the stations lie

  get currentPair() { return this.pair === null ? null : this.data.pairs[this.pair]; }

  poseOf(own, alternative = this.alternative) {
    const { name } = own.station;
    const pair = this.currentPair;
    if (pair) {
      if (name === pair.target) return poses.IDENTITY;
      if (name !== pair.source) return null;
      return pair.poses[alternative]?.target_from_source ?? poses.IDENTITY;
    }
    const low = Math.floor(this.stage);
    const before = this.data.stages[low]?.poses[name];
    const after = this.data.stages[Math.min(low + 1, this.data.stages.length - 1)]?.poses[name];
    if (this.stage === low || !before || !after) return (this.stage - low < 0.5 ? before : after) ?? null;
    return poses.between(before, after, this.stage - low, own.middle);
  }

  covarianceOf(own) {
    const pair = this.currentPair;
    if (pair) {
      if (own.station.name === pair.target) return zeros();
      return this.alternative === 0 && pair.poses[0]?.name === "answer" ? pair.covariance : null;
    }
    return this.stage === this.data.stages.length - 1 ? own.station.covariance : null;
  }

  // Lay the stations out; `alternative` is that of the part of the picture that is drawn.
  _place(alternative = this.alternative) {
    for (const own of this.stations) {
      const pose = this.poseOf(own, alternative);
      own.pose = pose;
      own.group.visible = Boolean(pose) && !this.hidden.has(own.station.name)
        && (this.only === null || this.only === own.station.name);
      if (!pose) continue;
      own.group.matrix.copy(matrix4(poses.moved(pose, poses.scaled(this.base, -1))));
      own.group.matrix.multiply(new THREE.Matrix4().makeTranslation(...own.middle));
      own.group.updateMatrixWorld(true);
    }
  }

  // After another pair, step or alternative was chosen.
  relayout() {
    const own = this.currentPair ? this.byName.get(this.currentPair.target) : null;
    this.base = own ? own.middle.map(Math.round) : this.origin;
    this._place();
    const box = new THREE.Box3();
    for (const each of this.stations) {
      if (!each.pose) continue;
      for (const point of each.outline) {
        box.expandByPoint(new THREE.Vector3(...poses.subtracted(poses.applied(each.pose, point), this.base)));
      }
    }
    if (!box.isEmpty()) this.views.box = box;
    this.shared.heights.value.set(this.views.box.min.z, this.views.box.max.z);
    this._spread();
    this.residuals.reset();
    this._showEvidence();
    this._showMarks();
    this._placeControl();
    this.invalidate();
  }

  // Known points have their place in the world, where the stations lie at the last step only.
  _placeControl() {
    this.control.visible = this.visible.control && !this.currentPair && this.stage === this.data.stages.length - 1;
    for (const mark of this.control.children) mark.position.set(...poses.subtracted(mark.userData.point.known_m, this.base));
  }

  // Standard deviations of the points' positions: what the shader needs, and between which limits they lie.
  _spread() {
    const seen = [];
    for (const own of this.stations) {
      const { uniforms } = own.cloud;
      const covariance = own.pose && this.covarianceOf(own);
      uniforms.varConstant.value = -1;
      if (!covariance) continue;
      const noise = own.station.noise_std_m;
      const v = poses.positionVariance(covariance, noise);
      uniforms.varConstant.value = v.constant;
      uniforms.varLinear.value.set(...v.linear);
      uniforms.varSquare.value = v.square;
      uniforms.varTurn.value.set(...v.turn.flat());
      const t = [own.pose[0][3], own.pose[1][3], own.pose[2][3]];
      uniforms.sensor.value.set(...poses.subtracted(t, this.base));
      const [low, high] = own.station.bounds_m;
      for (let corner = 0; corner < 9; corner += 1) {
        const point = corner === 8 ? own.middle : [0, 1, 2].map((axis) => ((corner >> axis) & 1 ? high : low)[axis]);
        const c = poses.pointCovariance(own.pose, covariance, poses.applied(own.pose, point), noise);
        seen.push(Math.sqrt(c[0][0] + c[1][1] + c[2][2]));
      }
    }
    this.stdLimits = seen.length ? [Math.min(...seen), Math.max(...seen)] : null;
    if (this.stdLimits) this.shared.stds.value.set(...this.stdLimits);
  }

  // Distances of the points of shown blocks to planes of others, as many as there is time for; tell whether all are there.
  _measureResiduals() {
    const { residuals } = this;
    const began = performance.now();
    for (const own of this.stations) {
      if (!own.group.visible) continue;
      for (const node of own.cloud.nodes) {
        if (!node.points?.visible || node.residuals === residuals.version) continue;
        if (performance.now() - began > RESIDUALS_MS) return false;
        const { geometry } = node.points;
        const found = residuals.of(own, node.middle, geometry.attributes.position.array);
        geometry.setAttribute("residual", new THREE.BufferAttribute(found, 1));
        node.residuals = residuals.version;
        this._freshResiduals = true;
      }
    }
    return true;
  }

  // Colours reach to a round number of some medians.
  _scaleResiduals() {
    const { median } = this.residuals;
    const wanted = Math.min(Math.max(4 * (median ?? REACH_M), 1e-3), REACH_M);
    const power = 10 ** Math.floor(Math.log10(wanted));
    this.shared.largestResidual.value = power * [1, 2, 5, 10].find((factor) => factor * power >= 0.999 * wanted);
  }

  // --- what is shown

  recolour() {
    this.shared.mode.value = COLOUR_MODES[this.colouring];
    for (const own of this.stations) own.features.recolour(this.featuresBy, this.selected);
    for (const { children: [mesh] } of this.control.children) {
      mesh.material.color.set(mesh.userData.feature.id === this.selected ? SELECTED : mesh.userData.colour);
    }
    for (const mark of this.evidence.children) {
      if (mark.isMesh) mark.material.color.set(mark.userData.feature.id === this.selected ? SELECTED : 0xff4d4d);
    }
    this.invalidate();
  }

  applyVisibility() {
    for (const own of this.stations) {
      own.cloud.group.visible = this.visible.points;
      for (const [kind, group] of Object.entries(own.features.groups)) group.visible = this.visible[kind];
    }
    this.evidence.visible = this.visible.pieces;
    this._placeControl();
    this.invalidate();
  }

  // Pieces of surface that stand where the other instrument looked through, with the line of sight.
  _showEvidence() {
    this.evidence.clear();
    const all = this.currentPair ? [this.currentPair]
      : this.data.pairs.filter((pair) => ["accepted", "coarse", "doubtful"].includes(pair.status));
    const pieces = all.flatMap((pair) => pair.unexplained.map((piece, number) => ({ pair, piece, number })));
    pieces.sort((a, b) => b.piece.area_m2 - a.piece.area_m2);
    pieces.slice(0, MOST_PIECES).forEach(({ pair, piece, number }) => {
      const own = this.byName.get(piece.station);
      const other = this.byName.get(piece.station === pair.target ? pair.source : pair.target);
      if (!own?.pose || !other?.pose) return;
      const at = new THREE.Vector3(...poses.subtracted(poses.applied(own.pose, piece.centre_m), this.base));
      const mesh = new THREE.Mesh(
        new THREE.SphereGeometry(Math.max(Math.sqrt(piece.area_m2 / Math.PI), 0.08), 20, 14),
        new THREE.MeshBasicMaterial({ color: 0xff4d4d, transparent: true, opacity: 0.45, depthWrite: false }),
      );
      mesh.position.copy(at);
      mesh.userData.feature = { id: `unexplained/${pair.target}/${pair.source}/${number}` };
      mesh.userData.piece = piece;
      this.evidence.add(mesh);
      if (!other.station.sensor_m) return;
      const from = poses.subtracted(poses.applied(other.pose, other.station.sensor_m), this.base);
      const geometry = new LineSegmentsGeometry();
      geometry.setPositions([...from, at.x, at.y, at.z]);
      this.evidence.add(new LineSegments2(geometry, lineMaterial(1.5, { color: 0xff8f8f, transparent: true, opacity: 0.7 })));
    });
    this._resizeLines();
  }

  // Marks of measured or picked points: [{station, point, text}], and segments between the marks of two.
  setMarks(marks, segments = []) {
    this._marks = marks;
    this._segments = segments;
    this._showMarks();
    this.invalidate();
  }

  _showMarks() {
    this.marks.clear();
    const at = (mark) => {
      const own = this.byName.get(mark.station);
      if (!own?.pose || (this.only !== null && this.only !== mark.station)) return null;
      return poses.subtracted(poses.applied(own.pose, mark.point), this.base);
    };
    for (const mark of this._marks ?? []) {
      const place = at(mark);
      if (!place) continue;
      const dot = new THREE.Sprite(new THREE.SpriteMaterial({ color: SELECTED, depthTest: false, sizeAttenuation: false }));
      dot.userData.size = [0.012, 0.012];
      dot.position.set(...place);
      dot.renderOrder = 9;
      const label = textSprite(mark.text, "#ffff80");
      label.position.set(...place);
      this.marks.add(dot, label);
    }
    for (const [a, b] of this._segments ?? []) {
      const ends = [at(a), at(b)];
      if (!ends[0] || !ends[1]) continue;
      const geometry = new LineSegmentsGeometry();
      geometry.setPositions(ends.flat());
      const line = new LineSegments2(geometry, lineMaterial(2.5, { color: SELECTED, depthTest: false }));
      line.renderOrder = 8;
      this.marks.add(line);
    }
    this._resizeLines();
  }

  // --- choosing

  find(id) {
    for (const own of this.stations) {
      const found = own.features.byId.get(id);
      if (found) return { own, ...found };
    }
    const known = this.control.children.find((mark) => mark.userData.point.id === id);
    if (known) return { known };
    const piece = this.evidence.children.find((mesh) => mesh.userData.feature?.id === id);
    return piece ? { piece } : null;
  }

  select(id, { look = false } = {}) {
    this.selected = id;
    const found = id && this.find(id);
    if (found?.own) {
      this.visible[found.kind] = true;
      this.applyVisibility();
    }
    if (found?.known) {
      this.visible.control = true;
      this.applyVisibility();
    }
    if (found && look) {
      const box = new THREE.Box3();
      if (found.known) box.setFromObject(found.known.children[0]);
      else if (found.piece) box.setFromObject(found.piece);
      else if (found.own.pose) {
        for (const point of found.points) {
          box.expandByPoint(new THREE.Vector3(...poses.subtracted(poses.applied(found.own.pose, point), this.base)));
        }
      }
      if (!box.isEmpty()) this.views.lookAt(box);
    }
    this.recolour();
    this.listeners.selected(id);
  }

  _ray(x, y) {
    const { width, height } = this.canvas.getBoundingClientRect();
    let [left, wide] = [0, width];
    if (this.beside !== null) { wide = width / 2; if (x >= wide) left = wide; }
    this._place(left > 0 ? this.beside : this.alternative);
    const raycaster = new THREE.Raycaster();
    raycaster.setFromCamera(new THREE.Vector2(2 * (x - left) / wide - 1, 1 - 2 * y / height), this.views.camera);
    raycaster.camera = this.views.camera;
    return raycaster;
  }

  // Does a point lie in the slab?
  _inSlab(own, point) {
    const { normal, half } = this.views.slab;
    if (half <= 0) return true;
    const at = new THREE.Vector3(...poses.subtracted(poses.applied(own.pose, point), this.base));
    return Math.abs(at.sub(this.views.target).dot(normal)) <= half;
  }

  // The measured point at a place of the picture: {station, point}; null: none.
  pointAt(x, y) {
    const { ray } = this._ray(x, y);
    const { camera } = this.views;
    const { height } = this.canvas.getBoundingClientRect();
    const isCone = camera.isPerspectiveCamera;
    const reach = isCone
      ? PICK_PX * 2 * Math.tan(THREE.MathUtils.degToRad(camera.fov) / 2) / height
      : PICK_PX * (camera.top - camera.bottom) / camera.zoom / height;
    if (!isCone) ray.origin.addScaledVector(ray.direction, -1000); // in front of all there is
    const byCloud = new Map(this.stations.map((own) => [own.cloud, own]));
    const found = pointOnRay(
      this.stations.map((own) => own.cloud), ray, isCone, reach, (cloud, point) => this._inSlab(byCloud.get(cloud), point),
    );
    if (!found) return null;
    return { station: byCloud.get(found.cloud).station.name, point: found.point };
  }

  // The feature at a place of the picture; null: none.
  featureAt(x, y) {
    const raycaster = this._ray(x, y);
    raycaster.params.Line2 = { threshold: PICK_PX };
    const candidates = [];
    for (const own of this.stations) {
      if (!own.group.visible) continue;
      for (const kind of ["lines", "edges", "targets", "instruments", "cylinders", "planes"]) {
        const group = own.features.groups[kind];
        if (!group.visible) continue;
        for (const hit of raycaster.intersectObjects(group.children.filter((object) => !object.isSprite), false)) {
          const feature = hit.object.userData.features?.[hit.faceIndex] ?? hit.object.userData.feature;
          if (feature) candidates.push([kind === "planes" ? 1 : 0, hit.distance, feature.id]);
        }
      }
    }
    if (this.control.visible) {
      for (const hit of raycaster.intersectObjects(this.control.children.map((mark) => mark.children[0]), false)) {
        candidates.push([0, hit.distance, hit.object.userData.feature.id]);
      }
    }
    if (this.evidence.visible) {
      for (const hit of raycaster.intersectObjects(this.evidence.children.filter((object) => object.isMesh && !object.isLineSegments2), false)) {
        candidates.push([0, hit.distance, hit.object.userData.feature.id]);
      }
    }
    candidates.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    return candidates[0]?.[2] ?? null;
  }

  end(mark) {
    const own = this.byName.get(mark.station);
    return {
      station: mark.station, point: mark.point, pose: this.poseOf(own), covariance: this.covarianceOf(own),
      noise_std_m: own.station.noise_std_m,
    };
  }

  // --- drawing

  // Blocks that come one after the other are drawn together.
  _loaded() {
    this._coming ??= setTimeout(() => { this._coming = null; this.invalidate(); }, this._isShown ? 100 : 0);
  }

  _moved() {
    this.isMoving = true;
    clearTimeout(this._rest);
    this._rest = setTimeout(() => { this.isMoving = false; this.invalidate(); }, REST_MS);
    this.invalidate();
  }

  invalidate() {
    if (this._asked) return;
    this._asked = true;
    requestAnimationFrame(() => { this._asked = false; this.draw(); });
  }

  _resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    this.renderer.setSize(width, height, false);
    this.size = [width, height];
    this.views.resize(this.beside === null ? width : width / 2, height);
    this._resizeLines();
    this.invalidate();
  }

  _resizeLines() {
    for (const material of lineMaterials) material.resolution.set(...(this.size ?? [1, 1]));
  }

  resized() { this._resize(); }

  draw() {
    if (!this.size) return;
    const began = performance.now();
    const [width, height] = this.size;
    const { camera, slab } = this.views;
    camera.updateMatrixWorld();
    this.shared.slabHalf.value = slab.half;
    const offset = slab.normal.dot(this.views.target);
    this.shared.slab.value.set(slab.normal.x, slab.normal.y, slab.normal.z, offset);
    this.renderer.clippingPlanes = slab.half > 0 ? [
      new THREE.Plane(slab.normal.clone(), slab.half - offset),
      new THREE.Plane(slab.normal.clone().negate(), slab.half + offset),
    ] : [];
    this.detail.isMoving = Boolean(this.isMoving && this._isShown);
    this.shared.size.value = this._pointSize();
    const spriteScale = camera.isPerspectiveCamera ? 1
      : (camera.top - camera.bottom) / camera.zoom / (2 * Math.tan(THREE.MathUtils.degToRad(this.views.perspective.fov) / 2));
    this.scene.traverse((object) => {
      if (object.isSprite) object.scale.set(object.userData.size[0] * spriteScale, object.userData.size[1] * spriteScale, 1);
    });
    this.renderer.setScissorTest(this.beside !== null);
    const parts = this.beside === null ? [[0, width, this.alternative]]
      : [[0, width / 2 - 1, this.alternative], [width / 2 + 1, width / 2 - 1, this.beside]];
    for (const [left, wide, alternative] of parts) {
      this._place(alternative);
      if (this.beside !== null) { this._showEvidence(); this._showMarks(); }
      this.detail.update(camera, height);
      const isLeft = left === 0;
      if (this.colouring === "residual" && isLeft && !this.detail.isMoving) {
        this.isMeasuring = !this._measureResiduals();
        if (this.isMeasuring) this._loaded();
        if (this._freshResiduals) this._scaleResiduals();
      }
      // distances are those of the pose to the left
      this.shared.mode.value = COLOUR_MODES[this.colouring === "residual" && !isLeft ? "station" : this.colouring];
      this.renderer.setViewport(left, 0, wide, height);
      this.renderer.setScissor(left, 0, wide, height);
      this.renderer.render(this.scene, camera);
    }
    if (this.detail.isMoving) { // the picture is waited for, so that it is known what it took
      this.waitForPixels();
      this.detail.drawn(performance.now() - began);
    }
    if (!this._isShown && this.detail.whole) {
      this._isShown = true;
      this.waitForPixels();
      this.listeners.first(performance.now(), this.detail.loadedBytes);
    }
    if (this._freshResiduals) {
      this._freshResiduals = false;
      this.listeners.measured();
    }
    this.listeners.changed();
  }

  // Wait until what was drawn is drawn; `finish` of WebGL does not.
  waitForPixels() {
    const gl = this.renderer.getContext();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  }

  _pointSize() {
    return (this.detail.shown < 300_000 ? 2.5 : 1.7) * this.renderer.getPixelRatio();
  }
}

// Points around all that a station shows: corners of its planes, or of the box where there are hardly any.
function outline(station) {
  const corners = station.planes.flatMap((plane) => plane.boundary_m);
  if (corners.length >= 12) return corners;
  const [low, high] = station.bounds_m;
  return [0, 1, 2, 3, 4, 5, 6, 7].map((corner) => [0, 1, 2].map((axis) => ((corner >> axis) & 1 ? high : low)[axis]));
}

function zeros() { return [0, 1, 2, 3, 4, 5].map(() => [0, 0, 0, 0, 0, 0]); }
