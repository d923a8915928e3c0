"""Compiled loops that lay the surface of one scan into another: what fits, and what stands where nothing can be."""

import math
from typing import Any

import numpy as np
from numba import njit

from algorithms.arrays import Array

FLATTEST = 0.1
"""Cosine of incidence below which surface may send nothing back (84 degrees; scanners lose it from 80 to 87 on): that
an instrument looked past its rim and did not see it says nothing against it."""
LEAST_VIOLATIONS = 10.0
"""Sifting gives no pose up before so much weight stands in free space."""

MARK = -2
"""Of cells that are near the surface."""


@njit(cache=True, nogil=True)
def mark_around(occupied: Array, reach: int, most: int, raster: Array) -> Any:  # pragma: no cover - compiled
    """Mark the cells that are near occupied ones, given by their numbers: at most the root of `most` cells away."""
    nx, ny, nz = raster.shape
    for number in occupied:
        i, j, m = number // (ny * nz), number // nz % ny, number % nz
        for a in range(max(i - reach, 0), min(i + reach + 1, nx)):
            for b in range(max(j - reach, 0), min(j + reach + 1, ny)):
                for c in range(max(m - reach, 0), min(m + reach + 1, nz)):
                    if (a - i) ** 2 + (b - j) ** 2 + (c - m) ** 2 <= most:
                        raster[a, b, c] = MARK


@njit(cache=True, nogil=True)
def nearest_points(
    points: Array, low: Array, cell_m: float, reach: float, numbers: Array, nearest: Array
) -> Any:  # pragma: no cover - compiled
    """Write the point nearest to the centre of each cell, of equally near ones the first.

    `numbers` (nx, ny, nz) tells where in `nearest` each cell stands, -1 for those that do not matter. Points farther
    than `reach` cells from a centre do not count; there `nearest` stays as it is.
    """
    nx, ny, nz = numbers.shape
    best = np.full(nearest.shape[0], reach * reach)
    steps = math.ceil(reach)
    for k in range(points.shape[0]):
        x = (points[k, 0] - low[0]) / cell_m - 0.5
        y = (points[k, 1] - low[1]) / cell_m - 0.5
        z = (points[k, 2] - low[2]) / cell_m - 0.5
        i, j, m = int(x + 0.5), int(y + 0.5), int(z + 0.5)
        for a in range(max(i - steps, 0), min(i + steps + 1, nx)):
            far_a = (x - a) ** 2
            for b in range(max(j - steps, 0), min(j + steps + 1, ny)):
                far_b = far_a + (y - b) ** 2
                if far_b >= reach * reach:
                    continue
                for c in range(max(m - steps, 0), min(m + steps + 1, nz)):
                    far = far_b + (z - c) ** 2
                    q = numbers[a, b, c]
                    if q >= 0 and far < best[q]:
                        best[q] = far
                        nearest[q] = k


@njit(cache=True)
def _angle(y: float, x: float) -> float:
    """Give atan2(y, x) to within 2e-5 rad: a cell is a thousand times larger."""
    ax, ay = abs(x), abs(y)
    if ax + ay < 1e-300:
        return 0.0
    a = min(ax, ay) / max(ax, ay)
    s = a * a
    r = ((((0.0208351 * s - 0.0851330) * s + 0.1801410) * s - 0.3302995) * s + 0.9998660) * a
    if ay > ax:
        r = 0.5 * math.pi - r
    if x < 0.0:
        r = math.pi - r
    return -r if y < 0.0 else r


@njit(cache=True, nogil=True)
def evidence(  # noqa: C901, PLR0915 - one loop, inlined for speed
    rotations: Array,
    translations: Array,
    points: Array,
    normals: Array,
    weights: Array,
    surface_points: Array,
    surface_normals: Array,
    owner: Array,
    low: Array,
    cell_m: float,
    nearest: Array,
    sensor: Array,
    cell_rad: float,
    limits: Array,
    sifting: bool,
    out: Array,
) -> Any:  # pragma: no cover - compiled
    """Write for each pose (weight that fits, weight in free space, moments of the normals that fit) of the points.

    The moments are the six different sums of weight n n' (xx, xy, xz, yy, yz, zz), in the frame of the moved scan.

    `limits`: largest distance from the plane, smallest cosine of the normals, largest distance along the surface,
    margin and relative margin of free space. `nearest` of size zero: nothing is known of free space. `sifting`: stop
    where clearly more stands in free space than fits, and extrapolate.
    """
    total = 0.0
    for k in range(points.shape[0]):
        total += weights[k]
    max_distance, min_cosine, reach, margin, relative = limits[0], limits[1], limits[2], limits[3], limits[4]
    rows, columns = nearest.shape
    nx, ny, nz = owner.shape
    for h in range(rotations.shape[0]):
        r = rotations[h]
        t = translations[h]
        fits = 0.0
        free = 0.0
        tried = 0.0
        xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(points.shape[0]):
            tried += weights[k]
            px, py, pz = points[k, 0], points[k, 1], points[k, 2]
            x = r[0, 0] * px + r[0, 1] * py + r[0, 2] * pz + t[0]
            y = r[1, 0] * px + r[1, 1] * py + r[1, 2] * pz + t[1]
            z = r[2, 0] * px + r[2, 1] * py + r[2, 2] * pz + t[2]
            i = math.floor((x - low[0]) / cell_m)
            j = math.floor((y - low[1]) / cell_m)
            m = math.floor((z - low[2]) / cell_m)
            if 0 <= i < nx and 0 <= j < ny and 0 <= m < nz:
                q = owner[i, j, m]
                if q >= 0:
                    dx, dy, dz = x - surface_points[q, 0], y - surface_points[q, 1], z - surface_points[q, 2]
                    off = surface_normals[q, 0] * dx + surface_normals[q, 1] * dy + surface_normals[q, 2] * dz
                    if abs(off) <= max_distance and dx * dx + dy * dy + dz * dz - off * off <= reach * reach:
                        ax, ay, az = normals[k, 0], normals[k, 1], normals[k, 2]
                        bx = r[0, 0] * ax + r[0, 1] * ay + r[0, 2] * az
                        by = r[1, 0] * ax + r[1, 1] * ay + r[1, 2] * az
                        bz = r[2, 0] * ax + r[2, 1] * ay + r[2, 2] * az
                        cosine = bx * surface_normals[q, 0] + by * surface_normals[q, 1] + bz * surface_normals[q, 2]
                        if cosine >= min_cosine:
                            w = weights[k]
                            fits += w
                            xx += w * ax * ax
                            xy += w * ax * ay
                            xz += w * ax * az
                            yy += w * ay * ay
                            yz += w * ay * az
                            zz += w * az * az
                            continue
            if rows == 0:
                continue
            x -= sensor[0]
            y -= sensor[1]
            z -= sensor[2]
            distance = math.sqrt(x * x + y * y + z * z)
            if distance < 1e-9:
                continue
            row = min(rows - 1, int(_angle(math.sqrt(x * x + y * y), z) / cell_rad))
            column = min(columns - 1, max(0, int((_angle(y, x) + math.pi) / cell_rad)))
            seen = nearest[row, column]
            if seen == np.inf or distance >= seen - margin - relative * seen:
                continue
            # in one cell a surface seen at a flat angle spans so much of range that nothing can be said of it
            ax, ay, az = normals[k, 0], normals[k, 1], normals[k, 2]
            cosine = abs(
                (r[0, 0] * ax + r[0, 1] * ay + r[0, 2] * az) * x
                + (r[1, 0] * ax + r[1, 1] * ay + r[1, 2] * az) * y
                + (r[2, 0] * ax + r[2, 1] * ay + r[2, 2] * az) * z
            )
            cosine /= distance
            span = cell_rad * distance * math.sqrt(max(1.0 - cosine * cosine, 0.0)) / max(cosine, FLATTEST)
            if cosine >= FLATTEST and distance < seen - span - margin - relative * seen:
                free += weights[k]
                if sifting and free > LEAST_VIOLATIONS + 2.0 * fits:
                    break
        scale = total / max(tried, 1e-12)
        out[h, 0] = scale * fits
        out[h, 1] = scale * free
        out[h, 2], out[h, 3], out[h, 4] = scale * xx, scale * xy, scale * xz
        out[h, 5], out[h, 6], out[h, 7] = scale * yy, scale * yz, scale * zz


@njit(cache=True)
def matched_surface(
    rotation: Array,
    translation: Array,
    points: Array,
    normals: Array,
    surface_points: Array,
    surface_normals: Array,
    owner: Array,
    low: Array,
    cell_m: float,
    limits: Array,
    match: Array,
) -> Any:  # pragma: no cover - compiled
    """Write for each moved point the number of the surface point it fits, -1 for none; limits as in `evidence`."""
    max_distance, min_cosine, reach = limits[0], limits[1], limits[2]
    nx, ny, nz = owner.shape
    r = rotation
    for k in range(points.shape[0]):
        match[k] = -1
        px, py, pz = points[k, 0], points[k, 1], points[k, 2]
        x = r[0, 0] * px + r[0, 1] * py + r[0, 2] * pz + translation[0]
        y = r[1, 0] * px + r[1, 1] * py + r[1, 2] * pz + translation[1]
        z = r[2, 0] * px + r[2, 1] * py + r[2, 2] * pz + translation[2]
        i = math.floor((x - low[0]) / cell_m)
        j = math.floor((y - low[1]) / cell_m)
        m = math.floor((z - low[2]) / cell_m)
        if not (0 <= i < nx and 0 <= j < ny and 0 <= m < nz):
            continue
        q = owner[i, j, m]
        if q < 0:
            continue
        dx, dy, dz = x - surface_points[q, 0], y - surface_points[q, 1], z - surface_points[q, 2]
        off = surface_normals[q, 0] * dx + surface_normals[q, 1] * dy + surface_normals[q, 2] * dz
        if abs(off) > max_distance or dx * dx + dy * dy + dz * dz - off * off > reach * reach:
            continue
        ax, ay, az = normals[k, 0], normals[k, 1], normals[k, 2]
        cosine = (
            (r[0, 0] * ax + r[0, 1] * ay + r[0, 2] * az) * surface_normals[q, 0]
            + (r[1, 0] * ax + r[1, 1] * ay + r[1, 2] * az) * surface_normals[q, 1]
            + (r[2, 0] * ax + r[2, 1] * ay + r[2, 2] * az) * surface_normals[q, 2]
        )
        if cosine >= min_cosine:
            match[k] = q
