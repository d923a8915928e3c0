// Lines, planes, cylinders and the instrument of one station, relative to a point near it.

import * as THREE from "three";
import { LineMaterial } from "three/addons/lines/LineMaterial.js";
import { LineSegments2 } from "three/addons/lines/LineSegments2.js";
import { LineSegmentsGeometry } from "three/addons/lines/LineSegmentsGeometry.js";
import { subtracted } from "./poses.js";

export const STATE_COLOURS = {
  used: 0x2fbf8f, reinstated: 0x2fbf8f, "not-controlled": 0xffb020, removed: 0xff5a4f, alone: 0x9aa4ae,
};
export const SELECTED = 0xffff40;
const TARGET = 0xff5ce1;
const CONTROL_COLOURS = { used: 0x2fbf8f, check: 0x5aa9ff, removed: 0xff5a4f };
export const MISS_TIMES = 100; // millimetres cannot be seen beside rooms
export const lineMaterials = [];

export function lineMaterial(width, options = {}) {
  const material = new LineMaterial({ linewidth: width, ...options });
  lineMaterials.push(material); // they must be told the size of the picture
  return material;
}

const residualColour = (ratio) => {
  if (ratio === null || ratio === undefined) return new THREE.Color(STATE_COLOURS.alone);
  return new THREE.Color().setHSL(0.38 * (1 - Math.min(ratio, 1)), 0.85, 0.55); // green: fits; red: at its limit
};

export const featureColour = (feature, by, own) => {
  if (by === "station") return own;
  return by === "residual" ? residualColour(feature.ratio) : new THREE.Color(STATE_COLOURS[feature.state] ?? STATE_COLOURS.alone);
};

export class StationFeatures {
  constructor(station, middle, colour) {
    this.station = station;
    this.middle = middle;
    this.colour = colour;
    this.byId = new Map();
    this.groups = {};
    for (const kind of ["lines", "edges", "planes", "cylinders", "targets", "instruments"]) this.groups[kind] = new THREE.Group();
    this._lines("lines", station.lines.filter((line) => line.source !== "photo-edge"));
    this._lines("edges", station.lines.filter((line) => line.source === "photo-edge"));
    station.planes.forEach((plane) => this._plane(plane));
    station.cylinders.forEach((cylinder) => this._cylinder(cylinder));
    if (station.sensor_m) this._instrument();
    this.addTargets(station.targets ?? []);
  }

  _at(point) { return subtracted(point, this.middle); }

  _lines(kind, lines) {
    if (!lines.length) return;
    const geometry = new LineSegmentsGeometry();
    geometry.setPositions(lines.flatMap((line) => [...this._at(line.start_m), ...this._at(line.end_m)]));
    geometry.setColors(new Float32Array(6 * lines.length));
    const drawn = new LineSegments2(geometry, lineMaterial(3, { vertexColors: true }));
    drawn.userData.features = lines;
    this.groups[kind].add(drawn);
    lines.forEach((line) => this.byId.set(line.id, { kind, feature: line, points: [line.start_m, line.end_m] }));
  }

  _plane(plane) {
    const corners = plane.boundary_m.map((corner) => new THREE.Vector3(...this._at(corner)));
    if (corners.length < 3) return;
    const normal = new THREE.Vector3(...plane.normal);
    const helper = Math.abs(normal.z) < 0.9 ? new THREE.Vector3(0, 0, 1) : new THREE.Vector3(1, 0, 0);
    const u = new THREE.Vector3().crossVectors(helper, normal).normalize();
    const v = new THREE.Vector3().crossVectors(normal, u);
    const flat = corners.map((corner) => new THREE.Vector2(corner.dot(u), corner.dot(v)));
    const faces = THREE.ShapeUtils.triangulateShape(flat, []);
    const geometry = new THREE.BufferGeometry().setFromPoints(corners);
    geometry.setIndex(faces.flat());
    const mesh = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({
      transparent: true, opacity: 0.22, side: THREE.DoubleSide, depthWrite: false,
    }));
    mesh.userData.feature = plane;
    this.groups.planes.add(mesh);
    this.byId.set(plane.id, { kind: "planes", feature: plane, points: plane.boundary_m, object: mesh });
  }

  _cylinder(cylinder) {
    const [start, end] = [cylinder.start_m, cylinder.end_m].map((point) => new THREE.Vector3(...this._at(point)));
    const along = new THREE.Vector3().subVectors(end, start);
    const geometry = new THREE.CylinderGeometry(cylinder.radius_m, cylinder.radius_m, along.length(), 24, 1, true);
    const mesh = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({
      transparent: true, opacity: 0.4, side: THREE.DoubleSide, depthWrite: false,
    }));
    mesh.position.addVectors(start, end).multiplyScalar(0.5);
    mesh.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), along.normalize());
    mesh.userData.feature = cylinder;
    this.groups.cylinders.add(mesh);
    this.byId.set(cylinder.id, {
      kind: "cylinders", feature: cylinder, points: [cylinder.start_m, cylinder.end_m], object: mesh,
    });
  }

  _instrument() {
    const mesh = new THREE.Mesh(
      new THREE.ConeGeometry(0.18, 0.4, 12), new THREE.MeshBasicMaterial({ color: this.colour }),
    );
    mesh.rotation.x = Math.PI / 2;
    mesh.position.set(...this._at(this.station.sensor_m));
    const label = textSprite(this.station.name, `#${this.colour.getHexString()}`);
    label.position.copy(mesh.position).add(new THREE.Vector3(0, 0, 0.5));
    const id = `station/${this.station.name}`;
    mesh.userData.feature = { id };
    this.groups.instruments.add(mesh, label);
    this.byId.set(id, { kind: "instruments", feature: { id }, points: [this.station.sensor_m], object: mesh });
  }

  // Targets that were measured in the scan, with their names.
  addTargets(targets) {
    for (const target of targets) {
      const feature = { ...target, id: `target/${this.station.name}/${target.name}` };
      const mesh = new THREE.Mesh(
        new THREE.OctahedronGeometry(0.08), new THREE.MeshBasicMaterial({ color: TARGET, transparent: true, opacity: 0.8 }),
      );
      mesh.position.set(...this._at(target.centre_m));
      const label = textSprite(target.name, "#ff9df2");
      label.position.copy(mesh.position).add(new THREE.Vector3(0, 0, 0.1));
      mesh.userData.feature = feature;
      this.groups.targets.add(mesh, label);
      this.byId.set(feature.id, { kind: "targets", feature, points: [target.centre_m], object: mesh });
    }
  }

  recolour(by, selected) {
    for (const kind of ["lines", "edges"]) {
      for (const drawn of this.groups[kind].children) {
        const colours = drawn.userData.features.flatMap((line) => {
          const colour = line.id === selected ? new THREE.Color(SELECTED) : featureColour(line, by, this.colour);
          return [colour.r, colour.g, colour.b, colour.r, colour.g, colour.b];
        });
        drawn.geometry.setColors(colours);
      }
    }
    for (const kind of ["planes", "cylinders"]) {
      for (const mesh of this.groups[kind].children) {
        const { feature } = mesh.userData;
        const isSelected = feature.id === selected;
        mesh.material.color.copy(isSelected ? new THREE.Color(SELECTED) : featureColour(feature, by, this.colour));
        mesh.material.opacity = isSelected ? 0.6 : kind === "planes" ? 0.22 : 0.4;
      }
    }
    for (const object of this.groups.targets.children) {
      if (object.isMesh) object.material.color.set(object.userData.feature.id === selected ? SELECTED : TARGET);
    }
    for (const object of this.groups.instruments.children) {
      if (object.isMesh) object.material.color.set(object.userData.feature.id === selected ? SELECTED : this.colour);
    }
  }
}

// A control or check point where it is known to be, at the origin of the group, and how far it was missed [m].
export function controlMark(point, miss) {
  const colour = CONTROL_COLOURS[point.state] ?? STATE_COLOURS.alone;
  const mesh = new THREE.Mesh(new THREE.ConeGeometry(0.1, 0.3, 12), new THREE.MeshBasicMaterial({ color: colour }));
  mesh.rotation.x = -Math.PI / 2; // its tip is at the point, so that the target there stays to be seen
  mesh.position.z = 0.15;
  mesh.userData.feature = point;
  mesh.userData.colour = colour;
  const label = textSprite(point.name, `#${new THREE.Color(colour).getHexString()}`);
  label.position.set(0, 0, 0.35);
  const group = new THREE.Group();
  group.add(mesh, label);
  if (miss) {
    const geometry = new LineSegmentsGeometry();
    geometry.setPositions([0, 0, 0, ...miss.map((value) => MISS_TIMES * value)]);
    group.add(new LineSegments2(geometry, lineMaterial(2, { color: colour })));
  }
  return group;
}

// A text that keeps its size on the screen.
export function textSprite(text, colour = "#ffffff") {
  const canvas = document.createElement("canvas");
  const context = canvas.getContext("2d");
  const font = "600 28px system-ui, sans-serif";
  context.font = font;
  canvas.width = Math.ceil(context.measureText(text).width) + 16;
  canvas.height = 40;
  context.font = font;
  context.fillStyle = "rgba(10, 14, 18, 0.65)";
  context.fillRect(0, 0, canvas.width, canvas.height);
  context.fillStyle = colour;
  context.textBaseline = "middle";
  context.fillText(text, 8, 21);
  const texture = new THREE.CanvasTexture(canvas);
  const sprite = new THREE.Sprite(new THREE.SpriteMaterial({ map: texture, depthTest: false, sizeAttenuation: false }));
  sprite.userData.size = [0.0009 * canvas.width, 0.0009 * canvas.height]; // of the picture's height, about
  sprite.center.set(0.5, 0);
  sprite.renderOrder = 10;
  return sprite;
}
