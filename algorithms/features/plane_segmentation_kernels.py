"""Compiled loops of plane segmentation: growing regions over cells, and labelling points."""

import numpy as np
from numba import njit

from algorithms.arrays import Array
from algorithms.scans.normals_kernels import smallest_axis


@njit(cache=True, nogil=True)
def grow_regions(  # noqa: C901, PLR0915 - one compiled loop
    order: Array,
    moments: Array,
    normals: Array,
    neighbours: Array,
    cap: float,
    cos_limit: float,
    distance_limits: Array,
    min_cells: int,
) -> tuple[Array, int]:
    """Grow regions of cells that lie on one plane, in the given order of seeds.

    A cell joins when its normal agrees with the region's plane and its mean lies on it within the cell's limit; the
    plane is fitted anew whenever the region has grown by a quarter. Regions below `min_cells` are dissolved. Returns
    labels and the number of regions.
    """
    m = moments.shape[0]
    labels = np.full(m, -1, dtype=np.int32)
    stack = np.empty(m, dtype=np.int32)
    count = 0
    for seed in order:
        if labels[seed] >= 0:
            continue
        ox, oy, oz = moments[seed, 1], moments[seed, 2], moments[seed, 3]
        nx, ny, nz = normals[seed, 0], normals[seed, 1], normals[seed, 2]
        d = 0.0
        w = sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
        refit_at = 12
        size = 0
        stack[0] = seed
        labels[seed] = count
        top = 1
        head = 0
        while head < top:  # breadth first: the region stays compact while its plane is still uncertain
            cell = stack[head]
            head += 1
            size += 1
            f = min(moments[cell, 0], cap)
            x = moments[cell, 1] - ox
            y = moments[cell, 2] - oy
            z = moments[cell, 3] - oz
            w += f
            sx += f * x
            sy += f * y
            sz += f * z
            xx += f * x * x
            xy += f * x * y
            xz += f * x * z
            yy += f * y * y
            yz += f * y * z
            zz += f * z * z
            if size >= refit_at:
                refit_at = size + max(12, size // 4)
                ax, ay, az = sx / w, sy / w, sz / w
                _, _, _, ux, uy, uz = smallest_axis(
                    xx / w - ax * ax,
                    xy / w - ax * ay,
                    xz / w - ax * az,
                    yy / w - ay * ay,
                    yz / w - ay * az,
                    zz / w - az * az,
                )
                dot = ux * nx + uy * ny + uz * nz
                if abs(dot) > 0.8:
                    sign = 1.0 if dot > 0 else -1.0
                    nx, ny, nz = sign * ux, sign * uy, sign * uz
                    d = nx * ax + ny * ay + nz * az
            for k in range(neighbours.shape[1]):
                other = neighbours[cell, k]
                if other < 0 or labels[other] >= 0:
                    continue
                dot = normals[other, 0] * nx + normals[other, 1] * ny + normals[other, 2] * nz
                if abs(dot) < cos_limit:
                    continue
                gap = (moments[other, 1] - ox) * nx + (moments[other, 2] - oy) * ny + (moments[other, 3] - oz) * nz - d
                if abs(gap) > distance_limits[other]:
                    continue
                labels[other] = count
                stack[top] = other
                top += 1
        if size < min_cells:
            for i in range(top):
                labels[stack[i]] = -1
        else:
            count += 1
    return labels, count


@njit(cache=True, nogil=True)
def dilate_labels(
    labels: Array, moments: Array, neighbours: Array, normals: Array, centroids: Array, tolerances: Array
) -> Array:
    """Give unlabelled cells the label of the neighbouring plane they lie on best, one ring."""
    out = labels.copy()
    for cell in range(labels.shape[0]):
        if labels[cell] >= 0:
            continue
        best = 1.0
        for k in range(neighbours.shape[1]):
            other = neighbours[cell, k]
            if other < 0 or labels[other] < 0:
                continue
            p = labels[other]
            gap = 0.0
            for a in range(3):
                gap += (moments[cell, 1 + a] - centroids[p, a]) * normals[p, a]
            gap = abs(gap) / tolerances[p]
            if gap < best:
                best = gap
                out[cell] = p
    return out


@njit(cache=True, nogil=True)
def touching_labels(labels: Array, neighbours: Array, count: int) -> Array:
    """Mark which regions touch, directly or across one unlabelled cell: (count, count) bool."""
    touch = np.zeros((count, count), dtype=np.bool_)
    around = np.empty(neighbours.shape[1], dtype=np.int32)
    for cell in range(labels.shape[0]):
        found = 0
        for k in range(neighbours.shape[1]):
            other = neighbours[cell, k]
            if other < 0 or labels[other] < 0:
                continue
            known = False
            for i in range(found):
                known = known or around[i] == labels[other]
            if not known:
                around[found] = labels[other]
                found += 1
        for i in range(found):
            if labels[cell] >= 0:
                touch[labels[cell], around[i]] = True
                touch[around[i], labels[cell]] = True
            else:
                for j in range(found):
                    touch[around[i], around[j]] = True
    return touch


@njit(cache=True, nogil=True)
def candidate_labels(labels: Array, neighbours: Array, width: int) -> Array:
    """List the different labels of each cell and its neighbours, own first: (m, width) int32, -1 padded."""
    out = np.full((labels.shape[0], width), -1, dtype=np.int32)
    for cell in range(labels.shape[0]):
        found = 0
        for k in range(-1, neighbours.shape[1]):
            other = cell if k < 0 else neighbours[cell, k]
            if other < 0 or labels[other] < 0 or found == width:
                continue
            known = False
            for i in range(found):
                known = known or out[cell, i] == labels[other]
            if not known:
                out[cell, found] = labels[other]
                found += 1
    return out


@njit(cache=True, nogil=True)
def label_points(
    points: Array, cell_of_point: Array, candidates: Array, normals: Array, centroids: Array, tolerances: Array
) -> tuple[Array, Array]:
    """Give each point the nearest plane among its cell's candidates.

    Returns labels (n,) int32, -1 for none, and a flag (n,) for points that lie within the tolerance of two planes:
    near an edge they belong to both, so they extend a plane but must not shape it.
    """
    n = points.shape[0]
    labels = np.full(n, -1, dtype=np.int32)
    shared = np.zeros(n, dtype=np.bool_)
    for i in range(n):
        cell = cell_of_point[i]
        if cell < 0:
            continue
        best = np.inf
        hits = 0
        for k in range(candidates.shape[1]):
            p = candidates[cell, k]
            if p < 0:
                break
            gap = abs(
                (points[i, 0] - centroids[p, 0]) * normals[p, 0]
                + (points[i, 1] - centroids[p, 1]) * normals[p, 1]
                + (points[i, 2] - centroids[p, 2]) * normals[p, 2]
            )
            if gap > tolerances[p]:
                continue
            hits += 1
            if gap < best:
                best = gap
                labels[i] = p
        shared[i] = hits > 1
    return labels, shared


@njit(cache=True, nogil=True)
def label_moments(points: Array, labels: Array, shared: Array, centroids: Array) -> Array:
    """Sum the moments of the unshared points of every label about the given centroids.

    Returns (k, 10): count, mean (absolute), central sums of products.
    """
    out = np.zeros((centroids.shape[0], 10))
    for i in range(points.shape[0]):
        p = labels[i]
        if p < 0 or shared[i]:
            continue
        x = points[i, 0] - centroids[p, 0]
        y = points[i, 1] - centroids[p, 1]
        z = points[i, 2] - centroids[p, 2]
        m = out[p]
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
    for p in range(centroids.shape[0]):
        m = out[p]
        n = m[0]
        if n > 0:
            x = m[1] / n
            y = m[2] / n
            z = m[3] / n
            m[4] -= n * x * x
            m[5] -= n * x * y
            m[6] -= n * x * z
            m[7] -= n * y * y
            m[8] -= n * y * z
            m[9] -= n * z * z
            m[1] = x + centroids[p, 0]
            m[2] = y + centroids[p, 1]
            m[3] = z + centroids[p, 2]
    return out


@njit(cache=True, nogil=True)
def plane_extents(points: Array, labels: Array, centroids: Array, bases: Array) -> Array:
    """Give the bounding rectangle of every label in plane coordinates: (k, 4) u_min, v_min, u_max, v_max."""
    k = centroids.shape[0]
    out = np.empty((k, 4))
    out[:, :2] = np.inf
    out[:, 2:] = -np.inf
    for i in range(points.shape[0]):
        p = labels[i]
        if p < 0:
            continue
        u = v = 0.0
        for a in range(3):
            x = points[i, a] - centroids[p, a]
            u += x * bases[p, a, 0]
            v += x * bases[p, a, 1]
        out[p, 0] = min(out[p, 0], u)
        out[p, 1] = min(out[p, 1], v)
        out[p, 2] = max(out[p, 2], u)
        out[p, 3] = max(out[p, 3], v)
    return out


@njit(cache=True, nogil=True)
def patch_sums(
    points: Array,
    labels: Array,
    shared: Array,
    centroids: Array,
    normals: Array,
    bases: Array,
    extents: Array,
    patch_sizes: Array,
    starts: Array,
    columns: Array,
) -> Array:
    """Sum points per rectangular patch of every plane: (patches, 5) count, u, v, residual, squared residual."""
    out = np.zeros((starts[-1], 5))
    for i in range(points.shape[0]):
        p = labels[i]
        if p < 0 or shared[i]:
            continue
        u = v = r = 0.0
        for a in range(3):
            x = points[i, a] - centroids[p, a]
            u += x * bases[p, a, 0]
            v += x * bases[p, a, 1]
            r += x * normals[p, a]
        row = int((v - extents[p, 1]) / patch_sizes[p, 1])
        column = int((u - extents[p, 0]) / patch_sizes[p, 0])
        s = out[starts[p] + row * columns[p] + column]
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
    centroids: Array,
    bases: Array,
    origins: Array,
    cell_sizes: Array,
    starts: Array,
    columns: Array,
) -> Array:
    """Mark the occupied raster cells of every plane in one flat uint8 array."""
    out = np.zeros(starts[-1], dtype=np.uint8)
    for i in range(points.shape[0]):
        p = labels[i]
        if p < 0:
            continue
        u = v = 0.0
        for a in range(3):
            x = points[i, a] - centroids[p, a]
            u += x * bases[p, a, 0]
            v += x * bases[p, a, 1]
        row = int((v - origins[p, 1]) / cell_sizes[p])
        column = int((u - origins[p, 0]) / cell_sizes[p])
        out[starts[p] + row * columns[p] + column] = 1
    return out
