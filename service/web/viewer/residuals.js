// How far points lie from the nearest plane that another station found, where the stations lie now.

import { added, applied, cross, dot, norm, scaled, subtracted, turned } from "./poses.js";

export const REACH_M = 0.1; // farther away a plane is another one
const BIN_M = 1e-4;
const MOST_CELLS = 200_000;
export const NOT_KNOWN = 0; // what is kept of a point is 1 more than its distance

export class Residuals {
  // `stations`: [{station, pose}], as they are laid out when something is asked
  constructor(stations) {
    this.stations = stations;
    this.version = 0;
    this.reset();
  }

  // The stations lie elsewhere: nothing is known any more.
  reset() {
    this.version += 1;
    this.planes = null;
    this.bins = new Uint32Array(Math.ceil(REACH_M / BIN_M) + 1);
    this.counted = 0;
  }

  // Half of the points that have a plane are nearer; null: there are none.
  get median() {
    let seen = 0;
    for (let bin = 0; bin < this.bins.length; bin += 1) {
      seen += this.bins[bin];
      if (seen > 0 && 2 * seen >= this.counted) return (bin + 0.5) * BIN_M;
    }
    return null;
  }

  _prepare() {
    this.planes = this.stations.filter((own) => own.pose).flatMap((own) => own.station.planes
      .filter((plane) => plane.boundary_m.length >= 3).map((plane) => placed(own, plane)));
    const low = [0, 1, 2].map((axis) => Math.min(...this.planes.map((plane) => plane.low[axis])) - REACH_M);
    const high = [0, 1, 2].map((axis) => Math.max(...this.planes.map((plane) => plane.high[axis])) + REACH_M);
    if (!this.planes.length) return;
    const size = subtracted(high, low);
    this.side = Math.max(0.5, Math.cbrt(size[0] * size[1] * size[2] / MOST_CELLS), Math.max(...size) / 1000);
    this.low = low;
    this.number = size.map((value) => Math.floor(value / this.side) + 1);
    this.cells = new Map();
    const reach = REACH_M + this.side * Math.sqrt(3) / 2;
    this.planes.forEach((plane, index) => {
      const [first, last] = [plane.low, plane.high].map((corner, k) => corner.map(
        (value, axis) => Math.floor((value - low[axis] + (k ? REACH_M : -REACH_M)) / this.side),
      ));
      for (let x = first[0]; x <= last[0]; x += 1) {
        for (let y = first[1]; y <= last[1]; y += 1) {
          for (let z = first[2]; z <= last[2]; z += 1) {
            const middle = [x, y, z].map((cell, axis) => low[axis] + (cell + 0.5) * this.side);
            if (Math.abs(dot(plane.normal, middle) - plane.offset) > reach) continue;
            const key = (x * this.number[1] + y) * this.number[2] + z;
            if (this.cells.has(key)) this.cells.get(key).push(index); else this.cells.set(key, [index]);
          }
        }
      }
    });
  }

  // One more than the distance of a point of a station, in the frame of the picture [m].
  _at(own, x, y, z) {
    const key = (Math.floor((x - this.low[0]) / this.side) * this.number[1] + Math.floor((y - this.low[1]) / this.side))
      * this.number[2] + Math.floor((z - this.low[2]) / this.side);
    let best = REACH_M;
    let found = NOT_KNOWN;
    for (const index of this.cells.get(key) ?? []) {
      const plane = this.planes[index];
      if (plane.own === own) continue;
      const { normal: n } = plane;
      const distance = Math.abs(n[0] * x + n[1] * y + n[2] * z - plane.offset);
      if (distance >= best || !isInside(plane, x, y, z)) continue;
      best = distance;
      found = 1 + distance;
    }
    return found;
  }

  // The same for many points: `xyz` relative to `middle`, in the coordinates of the station's file.
  of(own, middle, xyz) {
    if (!this.planes) this._prepare();
    const found = new Float32Array(xyz.length / 3);
    if (!this.planes.length) return found;
    const [a, b, c] = own.pose;
    const t = applied(own.pose, middle);
    for (let k = 0; k < found.length; k += 1) {
      const [x, y, z] = [xyz[3 * k], xyz[3 * k + 1], xyz[3 * k + 2]];
      found[k] = this._at(
        own, a[0] * x + a[1] * y + a[2] * z + t[0], b[0] * x + b[1] * y + b[2] * z + t[1], c[0] * x + c[1] * y + c[2] * z + t[2],
      );
      if (found[k] === NOT_KNOWN) continue;
      this.bins[Math.floor((found[k] - 1) / BIN_M)] += 1;
      this.counted += 1;
    }
    return found;
  }
}

// A plane in the frame of the picture: normal, offset, two directions in it, its outline along these.
function placed(own, plane) {
  const corners = plane.boundary_m.map((corner) => applied(own.pose, corner));
  const normal = turned(own.pose, plane.normal);
  const middle = scaled(corners.reduce(added), 1 / corners.length);
  const helper = Math.abs(normal[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0];
  const across = cross(helper, normal);
  const u = scaled(across, 1 / norm(across));
  const v = cross(normal, u);
  return {
    own,
    normal,
    offset: dot(normal, middle),
    u,
    v,
    outline: corners.map((corner) => [dot(corner, u), dot(corner, v)]),
    low: [0, 1, 2].map((axis) => Math.min(...corners.map((corner) => corner[axis]))),
    high: [0, 1, 2].map((axis) => Math.max(...corners.map((corner) => corner[axis]))),
  };
}

// Does a point lie over the outline of a plane? (It crosses the outline an odd number of times on its way out.)
function isInside({ u, v, outline }, x, y, z) {
  const a = u[0] * x + u[1] * y + u[2] * z;
  const b = v[0] * x + v[1] * y + v[2] * z;
  let inside = false;
  for (let k = 0, before = outline.length - 1; k < outline.length; before = k, k += 1) {
    const [xk, yk] = outline[k];
    const [xb, yb] = outline[before];
    if ((yk > b) !== (yb > b) && a < (xb - xk) * (b - yk) / (yb - yk) + xk) inside = !inside;
  }
  return inside;
}
