// The points of one station: an octree whose blocks are loaded as they are needed, the coarsest first.

import * as THREE from "three";

const BYTES_PER_POINT = 16;

// deviations are colours that the points bring
export const COLOUR_MODES = { station: 0, intensity: 1, rgb: 2, deviation: 2, height: 3, std: 4, residual: 5 };

const VERTEX = `
attribute vec4 channels;
attribute float residual;
uniform int mode;
uniform vec3 ownColour;
uniform float size;
uniform vec2 heights;
uniform vec2 stds;
uniform float largestResidual;
uniform vec3 sensor;
uniform float varConstant, varSquare;
uniform vec3 varLinear;
uniform mat3 varTurn;
uniform vec4 slab;
uniform float slabHalf;
varying vec3 colour;
varying float outside;
vec3 ramp(float t) {
  t = clamp(t, 0.0, 1.0);
  // the ramp "viridis", by a polynomial
  const vec3 c0 = vec3(0.2777, 0.0054, 0.3341), c1 = vec3(0.1051, 1.4046, 1.3846), c2 = vec3(-0.3309, 0.2148, 0.0951);
  const vec3 c3 = vec3(-4.6342, -5.7991, -19.3324), c4 = vec3(6.2283, 14.1799, 56.6906);
  const vec3 c5 = vec3(4.7764, -13.7451, -65.3530), c6 = vec3(-5.4355, 4.6459, 26.3124);
  return clamp(c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * (c5 + t * c6))))), 0.0, 1.0);
}
void main() {
  vec4 world = modelMatrix * vec4(position, 1.0);
  vec4 seen = modelViewMatrix * vec4(position, 1.0);
  gl_Position = projectionMatrix * seen;
  gl_PointSize = size;
  outside = slabHalf > 0.0 ? abs(dot(slab.xyz, world.xyz) - slab.w) - slabHalf : -1.0;
  if (mode == 1) colour = vec3(0.08 + 0.92 * channels.x);
  else if (mode == 2) colour = channels.yzw;
  else if (mode == 3) colour = ramp((world.z - heights.x) / max(heights.y - heights.x, 1e-6));
  else if (mode == 4) {
    vec3 r = world.xyz - sensor;
    float variance = varConstant + dot(varLinear, r) + varSquare * dot(r, r) - dot(r, varTurn * r);
    colour = varConstant < 0.0 ? vec3(0.5) : ramp((sqrt(max(variance, 0.0)) - stds.x) / max(stds.y - stds.x, 1e-9));
  } else if (mode == 5) {
    colour = residual == 0.0 ? vec3(0.35) : ramp((residual - 1.0) / largestResidual);
  } else colour = ownColour * (0.55 + 0.45 * channels.x);
}`;

const FRAGMENT = `
varying vec3 colour;
varying float outside;
void main() {
  if (outside > 0.0) discard;
  vec2 d = gl_PointCoord - 0.5;
  if (dot(d, d) > 0.25) discard;
  gl_FragColor = vec4(colour, 1.0);
}`;

export function sharedUniforms() {
  return {
    mode: { value: 0 },
    size: { value: 2 },
    heights: { value: new THREE.Vector2(0, 1) },
    stds: { value: new THREE.Vector2(0, 0.01) },
    largestResidual: { value: 0.01 },
    slab: { value: new THREE.Vector4(0, 0, 1, 0) },
    slabHalf: { value: 0 },
  };
}

class Node {
  constructor([level, x, y, z, firstByte, count], low, rootSide) {
    Object.assign(this, { level, x, y, z, firstByte, count });
    this.side = rootSide / 2 ** level;
    this.middle = [x, y, z].map((cell, axis) => low[axis] + (cell + 0.5) * this.side);
    this.children = [];
    this.points = null; // THREE.Points when loaded
    this.loading = false;
    this.lastUsed = 0;
  }

  get key() { return `${this.level}/${this.x}/${this.y}/${this.z}`; }

  get parentKey() { return `${this.level - 1}/${this.x >> 1}/${this.y >> 1}/${this.z >> 1}`; }
}

export class Cloud {
  // `middle`: origin of the group that the points are put into, in the coordinates of the file
  constructor(description, colour, middle, shared) {
    this.href = description.href;
    this.blocks = description.blocks;
    this.middle = middle;
    this.group = new THREE.Group();
    this.bytes = 0;
    this.uniforms = {
      ...shared,
      ownColour: { value: colour },
      sensor: { value: new THREE.Vector3() },
      varConstant: { value: -1 },
      varSquare: { value: 0 },
      varLinear: { value: new THREE.Vector3() },
      varTurn: { value: new THREE.Matrix3() },
    };
    this.material = new THREE.ShaderMaterial({
      uniforms: this.uniforms, vertexShader: VERTEX, fragmentShader: FRAGMENT,
    });
    this.nodes = [];
    this.roots = [];
    if (!this.blocks) return;
    const byKey = new Map();
    for (const entry of this.blocks.nodes) { // the coarsest first: parents are there before their children
      const node = new Node(entry, this.blocks.low_m, this.blocks.side_m);
      this.nodes.push(node);
      byKey.set(node.key, node);
      let parent = byKey.get(node.parentKey);
      for (let up = node; !parent && up.level > 0; parent = byKey.get(up.parentKey)) {
        up = { level: up.level - 1, x: up.x >> 1, y: up.y >> 1, z: up.z >> 1 };
        up.parentKey = `${up.level - 1}/${up.x >> 1}/${up.y >> 1}/${up.z >> 1}`;
      }
      if (parent) parent.children.push(node); else this.roots.push(node);
    }
  }

  get hasColour() { return Boolean(this.blocks?.has_color); }

  get hasIntensity() { return Boolean(this.blocks?.has_intensity); }

  async load(node, signal) {
    node.loading = true;
    try {
      const length = node.count * BYTES_PER_POINT;
      const answer = await fetch(this.href, {
        headers: { Range: `bytes=${node.firstByte}-${node.firstByte + length - 1}` },
        credentials: "same-origin",
        signal,
      });
      if (answer.status !== 206) throw new Error(`points: the service answers ${answer.status}`);
      const data = await answer.arrayBuffer();
      if (data.byteLength !== length) throw new Error("points: the service sent fewer bytes than asked for");
      this.bytes += length;
      const geometry = new THREE.BufferGeometry();
      const half = node.side / 2;
      const { xyz, channels } = scattered(data, node.count);
      geometry.setAttribute("position", new THREE.BufferAttribute(xyz, 3));
      geometry.setAttribute("channels", new THREE.BufferAttribute(channels, 4, true));
      geometry.boundingSphere = new THREE.Sphere(new THREE.Vector3(), half * Math.sqrt(3));
      const points = new THREE.Points(geometry, this.material);
      points.position.set(...node.middle.map((value, axis) => value - this.middle[axis]));
      points.matrixAutoUpdate = false;
      points.updateMatrix();
      points.visible = false;
      node.points = points;
      node.residuals = null; // of which layout they were measured
      this.group.add(points);
      points.updateWorldMatrix(true, false);
    } finally {
      node.loading = false;
    }
  }

  drop(node) {
    this.group.remove(node.points);
    node.points.geometry.dispose();
    node.points = null;
  }
}

// The points of a block in an order in which any first part of them lies all over the block.
function scattered(data, count) {
  const from = [new Float32Array(data, 0, 3 * count), new Uint32Array(data, 12 * count, count)];
  const xyz = new Float32Array(3 * count);
  const channels = new Uint32Array(count);
  let step = Math.max(1, Math.round(0.618034 * count));
  while (gcd(step, count) > 1) step += 1;
  for (let k = 0, at = 0; k < count; k += 1, at = (at + step) % count) {
    for (let axis = 0; axis < 3; axis += 1) xyz[3 * k + axis] = from[0][3 * at + axis];
    channels[k] = from[1][at];
  }
  return { xyz, channels: new Uint8Array(channels.buffer) };
}

function gcd(a, b) { return b ? gcd(b, a % b) : a; }
