// Ways to look: turning about a point, plan, and two sections with a slab that cuts out what is in front and behind.

import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

export const VIEWS = {
  orbit: { direction: [-0.55, 0.75, -0.55], up: [0, 0, 1] },
  plan: { direction: [0, 0, -1], up: [0, 1, 0] },
  front: { direction: [0, 1, 0], up: [0, 0, 1] },
  side: { direction: [-1, 0, 0], up: [0, 0, 1] },
};
const STEP_RAD = THREE.MathUtils.degToRad(5);

export class Views {
  constructor(canvas, changed) {
    this.canvas = canvas;
    this.changed = changed;
    this.box = new THREE.Box3(new THREE.Vector3(-1, -1, -1), new THREE.Vector3(1, 1, 1));
    this.perspective = new THREE.PerspectiveCamera(55, 1, 0.05, 1000);
    this.orthographic = new THREE.OrthographicCamera(-1, 1, 1, -1, -1000, 1000);
    this.name = "orbit";
    this.thickness = 0; // of the slab [m]; 0: all is shown
    this.controls = new OrbitControls(this.perspective, canvas);
    this.controls.enableDamping = false;
    this.controls.zoomToCursor = true;
    this.controls.addEventListener("change", changed);
  }

  get camera() { return this.name === "orbit" ? this.perspective : this.orthographic; }

  get target() { return this.controls.target; }

  resize(width, height) {
    this.aspect = width / height;
    this.perspective.aspect = this.aspect;
    this.perspective.updateProjectionMatrix();
    const half = (this.orthographic.top - this.orthographic.bottom) / 2;
    this.orthographic.left = -half * this.aspect;
    this.orthographic.right = half * this.aspect;
    this.orthographic.updateProjectionMatrix();
  }

  show(name) {
    this.name = name;
    this.thickness = name === "front" || name === "side" ? (this.thickness || 1) : 0;
    this.controls.object = this.camera;
    this.controls.enableRotate = name === "orbit";
    this.controls.mouseButtons.LEFT = name === "orbit" ? THREE.MOUSE.ROTATE : THREE.MOUSE.PAN;
    this.controls.touches.ONE = name === "orbit" ? THREE.TOUCH.ROTATE : THREE.TOUCH.PAN;
    this.fit();
  }

  fit(box = this.box) {
    const { direction, up } = VIEWS[this.name];
    const along = new THREE.Vector3(...direction).normalize();
    const sphere = box.getBoundingSphere(new THREE.Sphere());
    const radius = Math.max(sphere.radius, 0.3);
    const camera = this.camera;
    camera.up.set(...up);
    this.target.copy(sphere.center);
    if (this.name === "orbit") {
      const half = THREE.MathUtils.degToRad(camera.fov) / 2;
      const narrow = Math.min(half, Math.atan(Math.tan(half) * (this.aspect || 1)));
      camera.position.copy(this.target).addScaledVector(along, -radius * 0.8 / Math.sin(narrow));
      camera.near = Math.max(radius / 2000, 0.02);
      camera.far = radius * 40;
    } else {
      camera.position.copy(this.target).addScaledVector(along, -radius * 4);
      const size = box.getSize(new THREE.Vector3());
      const across = { plan: [size.x, size.y], front: [size.x, size.z], side: [size.y, size.z] }[this.name];
      const half = 0.55 * Math.max(across[1], across[0] / (this.aspect || 1), 0.5);
      Object.assign(camera, { top: half, bottom: -half, left: -half * this.aspect, right: half * this.aspect });
      camera.near = -radius * 40;
      camera.far = radius * 40;
      camera.zoom = 1;
    }
    camera.updateProjectionMatrix();
    camera.lookAt(this.target);
    this.controls.update();
    this.changed();
  }

  // Look at a place from where one looks now, near enough for it to fill a part of the picture.
  lookAt(box) {
    const sphere = box.getBoundingSphere(new THREE.Sphere());
    const camera = this.camera;
    const along = new THREE.Vector3().subVectors(this.target, camera.position);
    if (this.name === "orbit") {
      const wanted = Math.min(along.length(), Math.max(4 * sphere.radius, 3));
      this.target.copy(sphere.center);
      camera.position.copy(sphere.center).addScaledVector(along.normalize(), -wanted);
    } else {
      this.target.copy(sphere.center);
      camera.position.copy(sphere.center).sub(along);
    }
    this.controls.update();
    this.changed();
  }

  // Keys: turn or shift by a step, to the left, right, up or down.
  step(x, y, pans) {
    const camera = this.camera;
    if (this.name === "orbit" && !pans) {
      const offset = new THREE.Vector3().subVectors(camera.position, this.target);
      const toUp = new THREE.Quaternion().setFromUnitVectors(camera.up, new THREE.Vector3(0, 1, 0));
      const spherical = new THREE.Spherical().setFromVector3(offset.applyQuaternion(toUp));
      spherical.theta -= x * STEP_RAD;
      spherical.phi += y * STEP_RAD;
      spherical.makeSafe();
      offset.setFromSpherical(spherical).applyQuaternion(toUp.invert());
      camera.position.copy(this.target).add(offset);
    } else {
      const height = this.name === "orbit"
        ? 2 * Math.tan(THREE.MathUtils.degToRad(camera.fov) / 2) * camera.position.distanceTo(this.target)
        : (camera.top - camera.bottom) / camera.zoom;
      const right = new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, 0);
      const up = new THREE.Vector3().setFromMatrixColumn(camera.matrixWorld, 1);
      const shift = right.multiplyScalar(0.04 * height * x).addScaledVector(up, 0.04 * height * y);
      camera.position.add(shift);
      this.target.add(shift);
    }
    camera.lookAt(this.target);
    this.controls.update();
    this.changed();
  }

  zoom(factor) {
    const camera = this.camera;
    if (this.name === "orbit") {
      camera.position.sub(this.target).multiplyScalar(1 / factor).add(this.target);
    } else {
      camera.zoom *= factor;
      camera.updateProjectionMatrix();
    }
    this.controls.update();
    this.changed();
  }

  get slab() {
    const { direction } = VIEWS[this.name];
    return { normal: new THREE.Vector3(...direction).normalize(), half: this.thickness / 2 };
  }

  // Move the slab through the scene.
  shiftSlab(metres) {
    const shift = this.slab.normal.multiplyScalar(metres);
    this.target.add(shift);
    this.camera.position.add(shift);
    this.controls.update();
    this.changed();
  }

  saved() {
    const camera = this.camera;
    return { name: this.name, position: camera.position.clone(), target: this.target.clone(), zoom: camera.zoom };
  }

  restore(saved) {
    if (saved.name !== this.name) return;
    this.camera.position.copy(saved.position);
    this.target.copy(saved.target);
    this.camera.zoom = saved.zoom;
    this.camera.updateProjectionMatrix();
    this.controls.update();
    this.changed();
  }
}
