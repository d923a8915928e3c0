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
    points: Array, order: Array, low: Array, cell_m: float, reach: float, numbers: Array, nearest: Array
) -> Any:  # pragma: no cover - compiled
    """Write the point nearest to the centre of each cell, of equally near ones that of the lowest number.

    `numbers` (nx, ny, nz) tells where in `nearest` each cell stands, -1 for those that do not matter. Points farther
    than `reach` cells from a centre do not count; there `nearest` stays as it is. `order` lists the points so that
    neighbours come one after the other: the cells around them are still at hand then.
    """
    nx, ny, nz = numbers.shape
    best = np.full(nearest.shape[0], reach * reach)
    steps = math.ceil(reach)
    for k in order:
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
                    if q >= 0 and (far < best[q] or (far == best[q] and k < nearest[q])):
                        best[q] = far
                        nearest[q] = k


@njit(cache=True, nogil=True, error_model="numpy", inline="always")  # only inlined, loops become vectors
def _angle(y: float, x: float) -> float:
    """Give atan2(y, x) to within 2e-5 rad: a cell is a thousand times larger."""
    ax, ay = abs(x), abs(y)
    steep = ay > ax
    a = (ax if steep else ay) / ((ay if steep else ax) + 1e-300)
    s = a * a
    r = ((((0.0208351 * s - 0.0851330) * s + 0.1801410) * s - 0.3302995) * s + 0.9998660) * a
    r = 0.5 * math.pi - r if steep else r
    r = math.pi - r if x < 0.0 else r
    return -r if y < 0.0 else r


@njit(cache=True, nogil=True, error_model="numpy")
def moved_coordinates(row: Array, shift: float, px: Array, py: Array, pz: Array, out: Array) -> None:
    """Write one coordinate of moved points."""
    a, b, c = row[0], row[1], row[2]
    for k in range(len(px)):
        out[k] = a * px[k] + b * py[k] + c * pz[k] + shift


@njit(cache=True, nogil=True, error_model="numpy")
def raster_cells(
    x: Array, y: Array, z: Array, low: Array, cell_m: float, shape: tuple[int, int, int], out: Array
) -> None:
    """Write the numbers of the cells of a raster in which places lie, -1 outside of it."""
    per = 1.0 / cell_m
    lx, ly, lz = low[0], low[1], low[2]
    nx, ny, nz = np.int32(shape[0]), np.int32(shape[1]), np.int32(shape[2])
    for k in range(len(x)):
        i = np.int32(math.floor((x[k] - lx) * per))
        j = np.int32(math.floor((y[k] - ly) * per))
        m = np.int32(math.floor((z[k] - lz) * per))
        inside = (i >= 0) & (i < nx) & (j >= 0) & (j < ny) & (m >= 0) & (m < nz)
        out[k] = (i * ny + j) * nz + m if inside else -1


@njit(cache=True, nogil=True, error_model="numpy")
def _lengths(x: Array, y: Array, z: Array, out: Array) -> None:
    """Write the lengths of rays."""
    for k in range(len(x)):
        out[k] = math.sqrt(x[k] * x[k] + y[k] * y[k] + z[k] * z[k])


@njit(cache=True, nogil=True, error_model="numpy")
def _pixels(x: Array, y: Array, z: Array, cell_rad: float, shape: tuple[int, int], out: Array) -> None:
    """Write the numbers of the pixels of a range image to which rays lead."""
    per = 1.0 / cell_rad
    rows, columns = np.int32(shape[0]), np.int32(shape[1])
    for k in range(len(x)):
        row = np.int32(_angle(math.sqrt(x[k] * x[k] + y[k] * y[k]), z[k]) * per)
        column = np.int32((_angle(y[k], x[k]) + math.pi) * per)
        row = row if row < rows else rows - np.int32(1)
        column = column if column < columns else columns - np.int32(1)
        out[k] = row * columns + (column if column > 0 else np.int32(0))


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _stands_before(
    distance: float, seen: float, cosine: float, cell_rad: float, margin: float, relative: float
) -> bool:
    """Say whether surface at a distance, met at an angle of that cosine, stands clearly before what was seen.

    In one cell a surface met at a flat angle spans so much of range that nothing can be said of it.
    """
    span = cell_rad * distance * math.sqrt(max(1.0 - cosine * cosine, 0.0)) / max(cosine, FLATTEST)
    return cosine >= FLATTEST and distance < seen - span - margin - relative * seen


@njit(cache=True, nogil=True)
def seen_through(
    rays: Array, normals: Array, nearest: Array, cell_rad: float, margin: float, relative: float, across: float,
    out: Array,
) -> Any:  # pragma: no cover - compiled  # fmt: skip
    """Write for places, given by the rays that lead to them, (3, n) by axes, whether an instrument looked through them.

    `normals` (n, 3) are those of the surface that stands there, along the same axes. `across`: what was seen lies
    farther than this off the plane of that surface.
    """
    n = rays.shape[1]
    lengths, pixels, ranges = np.empty(n), np.empty(n, np.int32), nearest.ravel()
    _lengths(rays[0], rays[1], rays[2], lengths)
    _pixels(rays[0], rays[1], rays[2], cell_rad, nearest.shape, pixels)
    for k in range(n):
        seen = ranges[pixels[k]]
        out[k] = False
        if lengths[k] < 1e-9 or seen == np.inf:
            continue
        along = normals[k, 0] * rays[0, k] + normals[k, 1] * rays[1, k] + normals[k, 2] * rays[2, k]
        cosine = abs(along) / lengths[k]
        out[k] = _stands_before(lengths[k], seen, cosine, cell_rad, margin, relative)
        out[k] &= (seen - lengths[k]) * cosine >= across


BATCH = 64
"""So many points are moved and looked up together, in loops compiled into vector instructions."""


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
    `points` are given by axes, (3, n).

    `limits`: largest distance from the plane, smallest cosine of the normals, largest distance along the surface,
    margin and relative margin of free space. `nearest` of size zero: nothing is known of free space. `sifting`: stop
    where clearly more stands in free space than fits, and extrapolate.
    """
    n = points.shape[1]
    total = 0.0
    for k in range(n):
        total += weights[k]
    max_distance, min_cosine, reach, margin, relative = limits[0], limits[1], limits[2], limits[3], limits[4]
    owners, ranges = owner.ravel(), nearest.ravel()
    x, y, z = np.empty(BATCH), np.empty(BATCH), np.empty(BATCH)
    rx, ry, rz, lengths = np.empty(BATCH), np.empty(BATCH), np.empty(BATCH), np.empty(BATCH)
    cells, pixels = np.empty(BATCH, np.int32), np.empty(BATCH, np.int32)
    numbers, chosen, lies = np.empty(BATCH, np.int32), np.empty(BATCH + 1, np.int32), np.empty(BATCH, np.bool_)
    for h in range(rotations.shape[0]):
        r = rotations[h]
        r00, r01, r02 = r[0, 0], r[0, 1], r[0, 2]
        r10, r11, r12 = r[1, 0], r[1, 1], r[1, 2]
        r20, r21, r22 = r[2, 0], r[2, 1], r[2, 2]
        t = translations[h]
        fits = 0.0
        free = 0.0
        tried = 0.0
        xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for first in range(0, n, BATCH):
            count = min(BATCH, n - first)
            px, py, pz = points[0, first : first + count], points[1, first : first + count], points[2, first:]
            moved_coordinates(r[0], t[0], px, py, pz, x)
            moved_coordinates(r[1], t[1], px, py, pz, y)
            moved_coordinates(r[2], t[2], px, py, pz, z)
            raster_cells(x[:count], y, z, low, cell_m, owner.shape, cells)
            near = 0
            for k in range(count):  # these loops choose without branches: nobody can predict them
                tried += weights[first + k]
                numbers[k] = owners[cells[k]] if cells[k] >= 0 else -1
                lies[k] = False
                chosen[near] = k
                near += numbers[k] >= 0
            hits = 0
            for c in range(near):
                k = chosen[c]
                q = numbers[k]
                p = first + k
                dx, dy, dz = x[k] - surface_points[q, 0], y[k] - surface_points[q, 1], z[k] - surface_points[q, 2]
                sx, sy, sz = surface_normals[q, 0], surface_normals[q, 1], surface_normals[q, 2]
                off = sx * dx + sy * dy + sz * dz
                ax, ay, az = normals[p, 0], normals[p, 1], normals[p, 2]
                bx = r00 * ax + r01 * ay + r02 * az
                by = r10 * ax + r11 * ay + r12 * az
                bz = r20 * ax + r21 * ay + r22 * az
                fit = (
                    (abs(off) <= max_distance)
                    & (dx * dx + dy * dy + dz * dz - off * off <= reach * reach)
                    & (bx * sx + by * sy + bz * sz >= min_cosine)
                )
                lies[k] = fit
                chosen[hits] = k
                hits += fit
            for c in range(hits):
                p = first + chosen[c]
                w, ax, ay, az = weights[p], normals[p, 0], normals[p, 1], normals[p, 2]
                fits += w
                xx += w * ax * ax
                xy += w * ax * ay
                xz += w * ax * az
                yy += w * ay * ay
                yz += w * ay * az
                zz += w * az * az
            if len(ranges) == 0:
                continue
            left = 0
            for k in range(count):
                rx[left] = x[k] - sensor[0]
                ry[left] = y[k] - sensor[1]
                rz[left] = z[k] - sensor[2]
                chosen[left] = k
                left += not lies[k]
            _lengths(rx[:left], ry, rz, lengths)
            _pixels(rx[:left], ry, rz, cell_rad, nearest.shape, pixels)
            before = 0
            for k in range(left):
                seen = ranges[pixels[k]]
                kept = (lengths[k] >= 1e-9) & (seen != np.inf) & (lengths[k] < seen - margin - relative * seen)
                chosen[before] = chosen[k]
                rx[before], ry[before], rz[before], lengths[before] = rx[k], ry[k], rz[k], lengths[k]
                pixels[before] = pixels[k]
                before += kept
            for k in range(before):
                p = first + chosen[k]
                distance, seen = lengths[k], ranges[pixels[k]]
                ax, ay, az = normals[p, 0], normals[p, 1], normals[p, 2]
                cosine = abs(
                    (r00 * ax + r01 * ay + r02 * az) * rx[k]
                    + (r10 * ax + r11 * ay + r12 * az) * ry[k]
                    + (r20 * ax + r21 * ay + r22 * az) * rz[k]
                )
                if _stands_before(distance, seen, cosine / distance, cell_rad, margin, relative):
                    free += weights[p]
            if sifting and free > LEAST_VIOLATIONS + 2.0 * fits:
                break
        scale = total / max(tried, 1e-12)
        out[h, 0] = scale * fits
        out[h, 1] = scale * free
        out[h, 2], out[h, 3], out[h, 4] = scale * xx, scale * xy, scale * xz
        out[h, 5], out[h, 6], out[h, 7] = scale * yy, scale * yz, scale * zz


@njit(cache=True, nogil=True)
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
    """Write for each moved point, (3, n) by axes, the number of the surface point it fits, -1 for none."""
    max_distance, min_cosine, reach = limits[0], limits[1], limits[2]
    owners = owner.ravel()
    r = rotation
    x, y, z, cells = np.empty(BATCH), np.empty(BATCH), np.empty(BATCH), np.empty(BATCH, np.int32)
    for first in range(0, points.shape[1], BATCH):
        count = min(BATCH, points.shape[1] - first)
        px, py, pz = points[0, first : first + count], points[1, first : first + count], points[2, first:]
        moved_coordinates(r[0], translation[0], px, py, pz, x)
        moved_coordinates(r[1], translation[1], px, py, pz, y)
        moved_coordinates(r[2], translation[2], px, py, pz, z)
        raster_cells(x[:count], y, z, low, cell_m, owner.shape, cells)
        for k in range(count):
            p = first + k
            match[p] = -1
            q = owners[cells[k]] if cells[k] >= 0 else -1
            if q < 0:
                continue
            dx, dy, dz = x[k] - surface_points[q, 0], y[k] - surface_points[q, 1], z[k] - surface_points[q, 2]
            sx, sy, sz = surface_normals[q, 0], surface_normals[q, 1], surface_normals[q, 2]
            off = sx * dx + sy * dy + sz * dz
            if abs(off) > max_distance or dx * dx + dy * dy + dz * dz - off * off > reach * reach:
                continue
            ax, ay, az = normals[p, 0], normals[p, 1], normals[p, 2]
            cosine = (
                (r[0, 0] * ax + r[0, 1] * ay + r[0, 2] * az) * sx
                + (r[1, 0] * ax + r[1, 1] * ay + r[1, 2] * az) * sy
                + (r[2, 0] * ax + r[2, 1] * ay + r[2, 2] * az) * sz
            )
            if cosine >= min_cosine:
                match[p] = q
