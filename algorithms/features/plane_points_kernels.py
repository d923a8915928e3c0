"""Compiled passes over the points of planes: labelling, sums per plane and per patch, rasters.

Every kernel works on the points from `start` to `end`, so that blocks of points can be worked on at the same time.
`frames` holds a row per plane: normal (3), centroid (3), basis vectors E1 (3) and E2 (3), tolerance (1).
"""

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True, inline="always")
def _nearest(x: float, y: float, z: float, cell: int, candidates: Array, frames: Array) -> tuple[int, int]:
    """Give the nearest of the cell's candidate planes, -1 for none, and how many hold the point in their tolerance."""
    best = np.inf
    label = -1
    hits = 0
    for k in range(candidates.shape[1]):
        p = candidates[cell, k]
        if p < 0:
            break
        f = frames[p]
        gap = abs((x - f[3]) * f[0] + (y - f[4]) * f[1] + (z - f[5]) * f[2])
        if gap > f[12]:
            continue
        hits += 1
        if gap < best:
            best = gap
            label = p
    return label, hits


@njit(cache=True, nogil=True, inline="always")
def _add(m: Array, x: float, y: float, z: float) -> None:
    """Add a point to the sums: count, coordinates, products."""
    m[0] += 1.0
    m[1] += x
    m[2] += y
    m[3] += z
    m[4] += x * x
    m[5] += x * y
    m[6] += x * z
    m[7] += y * y
    m[8] += y * z
    m[9] += z * z


@njit(cache=True, nogil=True)
def sum_planes(points: Array, cell_of_point: Array, candidates: Array, frames: Array, start: int, end: int) -> Array:
    """Sum the points nearest to each plane: (k, 10) count, coordinates about its centroid, their products.

    Points within the tolerance of two planes are left out: near an edge they belong to both, and must not shape one.
    """
    out = np.zeros((frames.shape[0], 10))
    for i in range(start, end):
        cell = cell_of_point[i]
        if cell < 0:
            continue
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        p, hits = _nearest(x, y, z, cell, candidates, frames)
        if hits == 1:
            _add(out[p], x - frames[p, 3], y - frames[p, 4], z - frames[p, 5])
    return out


@njit(cache=True, nogil=True)
def label_points(
    points: Array,
    cell_of_point: Array,
    candidates: Array,
    frames: Array,
    start: int,
    end: int,
    labels: Array,
    shared: Array,
) -> tuple[Array, Array, Array]:
    """Write the nearest plane of every point, -1 for none, and whether it lies within the tolerance of two.

    Shared points extend a plane but do not shape it. Returns the sums of the others as `sum_planes` does, the number of
    all points of each plane, and their bounding rectangles (k, 4) u_min, v_min, u_max, v_max about its centroid.
    """
    k = frames.shape[0]
    out = np.zeros((k, 10))
    counts = np.zeros(k, dtype=np.int64)
    extents = np.empty((k, 4))
    extents[:, :2] = np.inf
    extents[:, 2:] = -np.inf
    for i in range(start, end):
        cell = cell_of_point[i]
        labels[i] = -1
        shared[i] = False
        if cell < 0:
            continue
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        p, hits = _nearest(x, y, z, cell, candidates, frames)
        if hits == 0:
            continue
        labels[i] = p
        shared[i] = hits > 1
        counts[p] += 1
        f = frames[p]
        x -= f[3]
        y -= f[4]
        z -= f[5]
        if hits == 1:
            _add(out[p], x, y, z)
        u = x * f[6] + y * f[7] + z * f[8]
        v = x * f[9] + y * f[10] + z * f[11]
        e = extents[p]
        e[0] = min(e[0], u)
        e[1] = min(e[1], v)
        e[2] = max(e[2], u)
        e[3] = max(e[3], v)
    return out, counts, extents


@njit(cache=True, nogil=True)
def sum_patches(
    points: Array,
    labels: Array,
    shared: Array,
    numbers: Array,
    frames: Array,
    corners: Array,
    patch_sizes: Array,
    starts: Array,
    columns: Array,
    start: int,
    end: int,
) -> Array:
    """Sum unshared points per rectangular patch of every plane: (patches, 5) count, u, v, residual, squared residual.

    `numbers` gives the plane of each label, -1 for none; `corners` (k, 2) is where the patches of a plane begin.
    """
    out = np.zeros((starts[-1], 5))
    for i in range(start, end):
        if labels[i] < 0 or shared[i]:
            continue
        p = numbers[labels[i]]
        if p < 0:
            continue
        f = frames[p]
        x = points[i, 0] - f[3]
        y = points[i, 1] - f[4]
        z = points[i, 2] - f[5]
        r = x * f[0] + y * f[1] + z * f[2]
        u = x * f[6] + y * f[7] + z * f[8]
        v = x * f[9] + y * f[10] + z * f[11]
        wide = columns[p]
        high = (starts[p + 1] - starts[p]) // wide
        # points at the rim may lie outside by rounding and by the tilt since the rectangle was measured
        column = min(max(int((u - corners[p, 0]) / patch_sizes[p, 0]), 0), wide - 1)
        row = min(max(int((v - corners[p, 1]) / patch_sizes[p, 1]), 0), high - 1)
        s = out[starts[p] + row * wide + column]
        s[0] += 1.0
        s[1] += u
        s[2] += v
        s[3] += r
        s[4] += r * r
    return out


@njit(cache=True, nogil=True)
def fill_rasters(
    points: Array,
    labels: Array,
    numbers: Array,
    frames: Array,
    origins: Array,
    cell_sizes: Array,
    starts: Array,
    rows: Array,
    columns: Array,
    start: int,
    end: int,
    out: Array,
) -> None:
    """Mark the occupied raster cells of every plane in one flat uint8 array; every block writes the same mark."""
    for i in range(start, end):
        if labels[i] < 0:
            continue
        p = numbers[labels[i]]
        if p < 0:
            continue
        f = frames[p]
        x = points[i, 0] - f[3]
        y = points[i, 1] - f[4]
        z = points[i, 2] - f[5]
        u = x * f[6] + y * f[7] + z * f[8]
        v = x * f[9] + y * f[10] + z * f[11]
        row = min(max(int((v - origins[p, 1]) / cell_sizes[p]), 0), rows[p] - 1)
        column = min(max(int((u - origins[p, 0]) / cell_sizes[p]), 0), columns[p] - 1)
        out[starts[p] + row * columns[p] + column] = 1
