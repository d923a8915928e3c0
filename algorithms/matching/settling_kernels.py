"""Compiled loops that settle many poses of two scans, surface on surface, before they are compared.

The step is that of `algorithms.matching.polish`, with the sums of hundreds of poses kept in registers; there the gaps
themselves are wanted, for covariances.
"""

import math
from typing import Any

import numpy as np
from numba import njit

from algorithms.arrays import Array
from algorithms.matching.polish import DOUBTFUL_SHARE, LEAST_GAPS, LEAST_INFORMATION, SETTLED_M, SETTLED_RAD
from algorithms.scans.surface_index_kernels import matched_surface

SUMS = 21 + 6 + 1 + 3 + 1 + 1
"""Normal equations (upper triangle, right-hand side), sums of weights, of weighted positions and of their squares, and
the count."""


@njit(cache=True)
def _accumulate(
    rotation: Array,
    translation: Array,
    points: Array,
    normals: Array,
    weights: Array,
    surface_points: Array,
    surface_normals: Array,
    owner: Array,
    low: Array,
    cell_m: float,
    limits: Array,
    centre: Array,
    backward: bool,
    sums: Array,
) -> Any:  # pragma: no cover - compiled
    """Add the gaps between moved points and a fixed surface to the normal equations about a centre.

    `rotation` and `translation` carry the moved points into the fixed scan. The equations are those of the pose of the
    source in the target frame: with `backward` the moved points are the target's. Points are given by axes, (3, n).
    """
    doubtful = DOUBTFUL_SHARE * limits[0]
    r = rotation
    row = np.empty(6)
    match = np.empty(points.shape[1], np.int64)
    matched_surface(
        rotation, translation, points, normals, surface_points, surface_normals, owner, low, cell_m, limits, match
    )
    for k in range(points.shape[1]):
        q = match[k]
        if q < 0:
            continue
        px, py, pz = points[0, k], points[1, k], points[2, k]
        x = r[0, 0] * px + r[0, 1] * py + r[0, 2] * pz + translation[0]
        y = r[1, 0] * px + r[1, 1] * py + r[1, 2] * pz + translation[1]
        z = r[2, 0] * px + r[2, 1] * py + r[2, 2] * pz + translation[2]
        sx, sy, sz = surface_normals[q, 0], surface_normals[q, 1], surface_normals[q, 2]
        off = sx * (x - surface_points[q, 0]) + sy * (y - surface_points[q, 1]) + sz * (z - surface_points[q, 2])
        if backward:
            # seen from the target: the source's surface moves, along the normal turned into the target frame
            gap = off
            wx = r[0, 0] * sx + r[1, 0] * sy + r[2, 0] * sz
            wy = r[0, 1] * sx + r[1, 1] * sy + r[2, 1] * sz
            wz = r[0, 2] * sx + r[1, 2] * sy + r[2, 2] * sz
            sx, sy, sz = wx, wy, wz
            x, y, z = px, py, pz
        else:
            gap = -off
        weight = weights[k] / (1.0 + (gap / doubtful) ** 2)
        x -= centre[0]
        y -= centre[1]
        z -= centre[2]
        row[0], row[1], row[2] = y * sz - z * sy, z * sx - x * sz, x * sy - y * sx
        row[3], row[4], row[5] = sx, sy, sz
        place = 0
        for a in range(6):
            scaled = weight * row[a]
            for b in range(a, 6):
                sums[place] += scaled * row[b]
                place += 1
            sums[21 + a] += scaled * gap
        # the centre of the equations is that of all gaps, with the weights that they have
        sums[27] += weight
        sums[28] += weight * x
        sums[29] += weight * y
        sums[30] += weight * z
        sums[31] += weight * (x * x + y * y + z * z)
        sums[32] += 1.0


@njit(cache=True)
def _solution(sums: Array, middle: Array) -> Any:  # pragma: no cover - compiled
    """Solve for (rotation vector, translation) about the centre of all gaps; `middle` becomes its offset."""
    matrix = np.empty((6, 6))
    place = 0
    for a in range(6):
        for b in range(a, 6):
            matrix[a, b] = matrix[b, a] = sums[place]
            place += 1
    for a in range(3):
        middle[a] = sums[28 + a] / sums[27]
    size = math.sqrt(max(sums[31] / sums[27] - (middle**2).sum(), 1e-6))
    # p x n about the other centre is p x n - middle x n
    moved = np.eye(6)
    moved[0, 4], moved[0, 5] = middle[2], -middle[1]
    moved[1, 3], moved[1, 5] = -middle[2], middle[0]
    moved[2, 3], moved[2, 4] = middle[1], -middle[0]
    for a in range(3):
        moved[a] /= size
    matrix = moved @ matrix @ moved.T
    values, vectors = np.linalg.eigh(matrix)
    projected = vectors.T @ (moved @ sums[21:27])
    for k in range(6):
        known = values[k] > LEAST_INFORMATION * values[5]
        projected[k] = projected[k] / values[k] if known else 0.0
    solution = vectors @ projected
    for a in range(3):
        solution[a] /= size
    return solution


@njit(cache=True)
def _rotation(vector: Array) -> Any:  # pragma: no cover - compiled
    """Give the rotation matrix of a rotation vector (Rodrigues)."""
    angle = math.sqrt((vector**2).sum())
    first = 1.0 if angle < 1e-8 else math.sin(angle) / angle
    second = 0.5 if angle < 1e-4 else (1.0 - math.cos(angle)) / angle**2
    x, y, z = vector[0], vector[1], vector[2]
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + first * cross + second * (cross @ cross)


@njit(cache=True, nogil=True)
def settle(
    rotations: Array,
    translations: Array,
    ours: Any,
    theirs: Any,
    limits: Array,
    rounds: int,
) -> Any:  # pragma: no cover - compiled
    """Settle every pose (target from source) in place.

    `ours` and `theirs` are the target and the source: points, normals and weights of their samples, all points and
    normals, owners, lowest corner and edge of the raster. `limits` has a row for each stage.
    """
    for h in range(len(rotations)):
        rotation, translation = rotations[h].copy(), translations[h].copy()
        for stage in range(len(limits)):
            for _ in range(rounds):
                sums = np.zeros(SUMS)
                back = np.ascontiguousarray(rotation.T)
                centre = translation.copy()
                _accumulate(
                    rotation, translation, theirs[0], theirs[1], theirs[2], ours[3], ours[4], ours[5], ours[6],
                    ours[7], limits[stage], centre, False, sums,
                )  # fmt: skip
                _accumulate(
                    back, -(back @ translation), ours[0], ours[1], ours[2], theirs[3], theirs[4], theirs[5], theirs[6],
                    theirs[7], limits[stage], centre, True, sums,
                )  # fmt: skip
                if sums[32] < LEAST_GAPS:
                    break
                middle = np.empty(3)
                solution = _solution(sums, middle)
                step = _rotation(solution[:3])
                pivot = centre + middle
                shift = solution[3:] + pivot - step @ pivot
                rotation = step @ rotation
                translation = step @ translation + shift
                if (solution[:3] ** 2).sum() < SETTLED_RAD**2 and (shift**2).sum() < SETTLED_M**2:
                    break
        rotations[h], translations[h] = rotation, translation
