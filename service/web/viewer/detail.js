// Which blocks are shown and which are loaded next: those that are large on the screen, within a budget of points.

import * as THREE from "three";

const DIVIDE_BEYOND_PX = 220; // a block that is larger on the screen is worth its children
const SIDE_BY_SIDE = 6;
export const POINTS_AT_REST = 2_500_000;
const POINTS_IN_MOTION = 200_000; // to begin with; then as many as a frame has time for
const LEAST_IN_MOTION = 20_000;
const FRAME_MS = 50; // turning stays smooth, also where a program draws and no graphics card
const MOST_LOADED = 8_000_000;

export class Detail {
  constructor(clouds, changed, failed) {
    Object.assign(this, { clouds, changed, failed });
    this.isMoving = false;
    this.inMotion = POINTS_IN_MOTION;
    this.shown = 0; // points of the blocks that are shown; while the picture moves a part of each is drawn
    this.loading = 0;
    this.loadedPoints = 0;
    this.loadedBytes = 0;
    this.frame = 0;
    this.whole = false; // whether the coarsest blocks of all stations that are shown are in the picture
    this._frustum = new THREE.Frustum();
    this._sphere = new THREE.Sphere();
    this._matrix = new THREE.Matrix4();
  }

  // Sizes of a block's cube on the screen [px]; -1: it is not in the picture.
  _size(cloud, node, camera, heightPx) {
    const scaleless = this._sphere;
    scaleless.center.set(...node.middle.map((value, axis) => value - cloud.middle[axis])).applyMatrix4(cloud.group.matrixWorld);
    scaleless.radius = node.side * Math.sqrt(3) / 2;
    if (!this._frustum.intersectsSphere(scaleless)) return -1;
    if (camera.isOrthographicCamera) return node.side * camera.zoom * heightPx / (camera.top - camera.bottom);
    const distance = Math.max(scaleless.center.distanceTo(camera.position) - scaleless.radius, camera.near);
    return node.side * heightPx / (2 * Math.tan(THREE.MathUtils.degToRad(camera.fov) / 2) * distance);
  }

  update(camera, heightPx) {
    this.frame += 1;
    this._matrix.multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse);
    this._frustum.setFromProjectionMatrix(this._matrix);
    const open = [];
    for (const cloud of this.clouds) {
      for (const node of cloud.nodes) if (node.points) node.points.visible = false;
      if (!cloud.group.parent?.visible) continue;
      for (const node of cloud.roots) open.push([Number.MAX_VALUE, cloud, node]);
    }
    const wanted = [];
    const budget = this.isMoving ? Math.max(this.inMotion, open.reduce((sum, [, , node]) => sum + node.count, 0)) : POINTS_AT_REST;
    this.shown = 0;
    this.whole = open.every(([, , node]) => node.points);
    while (open.length) {
      let best = 0;
      for (let k = 1; k < open.length; k += 1) if (open[k][0] > open[best][0]) best = k;
      const [size, cloud, node] = open[best];
      open[best] = open[open.length - 1];
      open.pop();
      if (this.shown + node.count > budget) break;
      if (!node.points) { // children wait for it
        if (!node.loading) wanted.push([cloud, node]);
        continue;
      }
      node.points.visible = true;
      node.lastUsed = this.frame;
      this.shown += node.count;
      if (size < DIVIDE_BEYOND_PX || !this.whole) continue; // the first picture comes first
      for (const child of node.children) {
        const own = this._size(cloud, child, camera, heightPx);
        if (own >= 0) open.push([own, cloud, child]);
      }
    }
    const share = this.isMoving ? Math.min(1, this.inMotion / this.shown) : 1;
    for (const cloud of this.clouds) {
      for (const node of cloud.nodes) {
        if (node.points?.visible) node.points.geometry.setDrawRange(0, Math.ceil(share * node.count));
      }
    }
    this._load(wanted);
  }

  // A frame that moved was drawn: the next has as many points as suit the time that it may take.
  drawn(ms) {
    const factor = Math.min(Math.max(FRAME_MS / Math.max(ms, 1), 0.4), 1.3);
    this.inMotion = Math.min(Math.max(this.inMotion * factor, LEAST_IN_MOTION), POINTS_AT_REST);
  }

  _load(wanted) {
    for (const [cloud, node] of wanted) {
      if (this.loading >= SIDE_BY_SIDE) return;
      this.loading += 1;
      cloud.load(node)
        .then(() => {
          this.loadedPoints += node.count;
          this.loadedBytes += 16 * node.count;
          this._makeRoom();
        })
        .catch((error) => { node.loading = true; this.failed(error); }) // it is not asked for again
        .finally(() => {
          this.loading -= 1;
          this.changed();
        });
    }
  }

  _makeRoom() {
    if (this.loadedPoints <= MOST_LOADED) return;
    const idle = [];
    for (const cloud of this.clouds) {
      for (const node of cloud.nodes) {
        if (node.points && node.lastUsed < this.frame && !cloud.roots.includes(node)) idle.push([cloud, node]);
      }
    }
    idle.sort((a, b) => a[1].lastUsed - b[1].lastUsed);
    for (const [cloud, node] of idle) {
      if (this.loadedPoints <= MOST_LOADED) return;
      cloud.drop(node);
      this.loadedPoints -= node.count;
    }
  }
}

// The nearest shown point to a ray: {cloud, point (coordinates of the file), distance along the ray}, or null.
// `reach`: half angle of the cone (perspective) or radius of the tube (orthographic, m).
export function pointOnRay(clouds, ray, isCone, reach, isInside) {
  let best = null;
  const inverse = new THREE.Matrix4();
  const local = new THREE.Ray();
  for (const cloud of clouds) {
    if (!cloud.group.parent?.visible) continue;
    for (const node of cloud.nodes) {
      if (!node.points?.visible) continue;
      inverse.copy(node.points.matrixWorld).invert();
      local.copy(ray).applyMatrix4(inverse);
      const o = local.origin;
      const d = local.direction;
      const far = node.side; // farther than any point from the middle
      const middle = -(o.x * d.x + o.y * d.y + o.z * d.z);
      const off = Math.sqrt(Math.max(0, o.lengthSq() - middle * middle));
      if (off > far + (isCone ? reach * Math.max(middle + far, 0) : reach)) continue;
      const xyz = node.points.geometry.attributes.position.array;
      for (let k = 0; k < xyz.length; k += 3) {
        const x = xyz[k] - o.x;
        const y = xyz[k + 1] - o.y;
        const z = xyz[k + 2] - o.z;
        const t = x * d.x + y * d.y + z * d.z;
        if (t <= 0) continue;
        const across = x * x + y * y + z * z - t * t;
        const limit = isCone ? reach * t : reach;
        if (across > limit * limit) continue;
        const cost = t + 4 * Math.sqrt(Math.max(across, 0)) / Math.max(limit, 1e-9) * (isCone ? 0.02 * t : 0.05);
        if (best && cost >= best.cost) continue;
        const point = [node.middle[0] + xyz[k], node.middle[1] + xyz[k + 1], node.middle[2] + xyz[k + 2]];
        if (!isInside(cloud, point)) continue;
        best = { cost, cloud, point };
      }
    }
  }
  return best;
}
