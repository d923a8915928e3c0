// Rigid motions as 4x4 matrices, row by row, in float64; what is known of a point that a pose carries, and of distances.

export const IDENTITY = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];

export const subtracted = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const added = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const scaled = (a, factor) => [a[0] * factor, a[1] * factor, a[2] * factor];
export const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const norm = (a) => Math.sqrt(dot(a, a));

export function applied(pose, p) {
  return [0, 1, 2].map((i) => pose[i][0] * p[0] + pose[i][1] * p[1] + pose[i][2] * p[2] + pose[i][3]);
}

export function turned(pose, v) {
  return [0, 1, 2].map((i) => pose[i][0] * v[0] + pose[i][1] * v[1] + pose[i][2] * v[2]);
}

export function product(a, b) {
  return a.map((row) => [0, 1, 2, 3].map((j) => row.reduce((sum, value, k) => sum + value * b[k][j], 0)));
}

export function inverse(pose) {
  const t = [pose[0][3], pose[1][3], pose[2][3]];
  const rows = [0, 1, 2].map((i) => [pose[0][i], pose[1][i], pose[2][i]]);
  return [...rows.map((row) => [...row, -dot(row, t)]), [0, 0, 0, 1]];
}

export const moved = (pose, shift) => pose.map((row, i) => (i < 3 ? [row[0], row[1], row[2], row[3] + shift[i]] : row));

// Covariance (3x3, m^2) of a point in the world: its pose, and the noise of the scan, taken as equal in all directions.
// dp = dtheta x (p - t) + dt, as algorithms/CONVENTIONS.md has it.
export function pointCovariance(pose, covariance, pointInWorld, noise) {
  const r = subtracted(pointInWorld, [pose[0][3], pose[1][3], pose[2][3]]);
  const rows = [
    [0, r[2], -r[1], 1, 0, 0],
    [-r[2], 0, r[0], 0, 1, 0],
    [r[1], -r[0], 0, 0, 0, 1],
  ];
  return rows.map((a, i) => rows.map((b, j) => {
    let sum = i === j ? noise * noise : 0;
    if (covariance) a.forEach((x, k) => { if (x) b.forEach((y, l) => { if (y) sum += x * covariance[k][l] * y; }); });
    return sum;
  }));
}

const along = (matrix, u) => dot(u, matrix.map((row) => dot(row, u)));

// Distance of two points and its standard deviation.
// Each end: {station, pose, covariance (null: unknown), noise_std_m (null: unknown), point (in the coordinates of its scan)}.
// Within one station the pose moves both ends alike and only the noise of the scan counts. Between two stations their
// poses count as independent, because the document does not tell their correlation.
export function distanceWithStd(a, b) {
  const ends = [applied(a.pose, a.point), applied(b.pose, b.point)];
  const difference = subtracted(ends[1], ends[0]);
  const distance = norm(difference);
  const u = distance > 0 ? scaled(difference, 1 / distance) : [0, 0, 1];
  const same = a.station === b.station;
  const variances = [a, b].map((end, k) => along(
    pointCovariance(end.pose, same ? null : end.covariance, ends[k], end.noise_std_m), u,
  ));
  const known = a.noise_std_m !== null && b.noise_std_m !== null && (same || (a.covariance !== null && b.covariance !== null));
  return { distance_m: distance, std_m: known ? Math.sqrt(variances[0] + variances[1]) : null, ends, difference };
}

// Variance of position, all directions together, as a polynomial of r = p - t: constant + linear . r + square |r|^2 - r^T turn r.
// With S the covariance: constant = tr S_tt, square = tr S_qq, turn = S_qq, linear from the skew part of S_qt.
export function positionVariance(covariance, noise) {
  const trace = (offset) => covariance[offset][offset] + covariance[offset + 1][offset + 1] + covariance[offset + 2][offset + 2];
  const c = (i, j) => covariance[i][3 + j];
  return {
    constant: trace(3) + 3 * noise * noise,
    linear: [2 * (c(1, 2) - c(2, 1)), 2 * (c(2, 0) - c(0, 2)), 2 * (c(0, 1) - c(1, 0))],
    square: trace(0),
    turn: [0, 1, 2].map((i) => [0, 1, 2].map((j) => covariance[i][j])),
  };
}

// Quaternion (w, x, y, z) of the rotation of a pose.
export function quaternionOf(m) {
  const trace = m[0][0] + m[1][1] + m[2][2];
  const q = [
    Math.sqrt(Math.max(0, 1 + trace)) / 2,
    Math.sqrt(Math.max(0, 1 + m[0][0] - m[1][1] - m[2][2])) / 2,
    Math.sqrt(Math.max(0, 1 - m[0][0] + m[1][1] - m[2][2])) / 2,
    Math.sqrt(Math.max(0, 1 - m[0][0] - m[1][1] + m[2][2])) / 2,
  ];
  const largest = q.indexOf(Math.max(...q));
  const f = 1 / (4 * q[largest]);
  if (largest === 0) return [q[0], (m[2][1] - m[1][2]) * f, (m[0][2] - m[2][0]) * f, (m[1][0] - m[0][1]) * f];
  if (largest === 1) return [(m[2][1] - m[1][2]) * f, q[1], (m[0][1] + m[1][0]) * f, (m[0][2] + m[2][0]) * f];
  if (largest === 2) return [(m[0][2] - m[2][0]) * f, (m[0][1] + m[1][0]) * f, q[2], (m[1][2] + m[2][1]) * f];
  return [(m[1][0] - m[0][1]) * f, (m[0][2] + m[2][0]) * f, (m[1][2] + m[2][1]) * f, q[3]];
}

function rotationOf([w, x, y, z]) {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
  ];
}

// Pose between two poses: the place of `middle` (in the scan) moves on a straight line, the axes turn evenly.
export function between(a, b, share, middle) {
  if (share <= 0) return a;
  if (share >= 1) return b;
  const p = quaternionOf(a);
  let q = quaternionOf(b);
  let cosine = p.reduce((sum, value, k) => sum + value * q[k], 0);
  if (cosine < 0) { q = q.map((value) => -value); cosine = -cosine; }
  const angle = Math.acos(Math.min(1, cosine));
  const weights = angle < 1e-6 ? [1 - share, share]
    : [Math.sin((1 - share) * angle) / Math.sin(angle), Math.sin(share * angle) / Math.sin(angle)];
  let mixed = p.map((value, k) => weights[0] * value + weights[1] * q[k]);
  const length = Math.hypot(...mixed);
  mixed = mixed.map((value) => value / length);
  const rotation = rotationOf(mixed);
  const place = added(scaled(applied(a, middle), 1 - share), scaled(applied(b, middle), share));
  const t = subtracted(place, rotation.map((row) => dot(row, middle)));
  return [...rotation.map((row, i) => [...row, t[i]]), [0, 0, 0, 1]];
}
