"""Compiled loops that find the plane on each side of an edge, and what else is near the edge."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array
from algorithms.scans.normals_kernels import smallest_axis

TRIPLES = 80
"""Planes through three points tried on each side."""
SAMPLE = 240
"""Points of a side that vote for them."""
TRIM = 3.5
"""Points farther from the plane than so many standard deviations do not belong to it."""
ROUNDS = 6


@njit(cache=True, nogil=True)
def _next(state: int) -> int:
    """Step a linear congruential generator (Numerical Recipes), so that the same input gives the same planes."""
    return (state * 1664525 + 1013904223) & 0xFFFFFFFF


@njit(cache=True, nogil=True)
def _sampled_plane(points: Array, chosen: Array, count: int, limit: float, state: int, plane: Array) -> float:
    """Find the plane through three of the chosen points that most of them lie on; plane = (normal, point)."""
    best = 0.0
    step = max(1, count // SAMPLE)
    for _ in range(TRIPLES):
        state = _next(state)
        a = chosen[(state >> 8) % count]
        state = _next(state)
        b = chosen[(state >> 8) % count]
        state = _next(state)
        c = chosen[(state >> 8) % count]
        ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
        vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        longest = max(ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz)
        # the height of the triangle must carry the tilt: a few times the noise of its corners
        if length <= limit * math.sqrt(longest) or length == 0.0:
            continue
        nx, ny, nz = nx / length, ny / length, nz / length
        score = 0.0
        for k in range(0, count, step):
            i = chosen[k]
            r = (
                nx * (points[i, 0] - points[a, 0])
                + ny * (points[i, 1] - points[a, 1])
                + nz * (points[i, 2] - points[a, 2])
            ) / limit
            if r * r < 1.0:
                score += 1.0 - r * r
        if score > best:
            best = score
            plane[0], plane[1], plane[2] = nx, ny, nz
            plane[3], plane[4], plane[5] = points[a, 0], points[a, 1], points[a, 2]
    return best


@njit(cache=True, nogil=True)
def _refit(
    points: Array, across: Array, first: int, last: int, side: float, gap: float, width: float, limit: float,
    plane: Array, moments: Array,
) -> bool:  # fmt: skip
    """Fit the plane anew to the points of one side within `limit` of it: moments = count, mean, central sums."""
    n = 0.0
    ox, oy, oz = plane[3], plane[4], plane[5]
    sx = sy = sz = xx = xy = xz = yy = yz = zz = 0.0
    for i in range(first, last):
        d = side * across[i]
        if d < gap or d > width:
            continue
        x, y, z = points[i, 0] - ox, points[i, 1] - oy, points[i, 2] - oz
        if abs(plane[0] * x + plane[1] * y + plane[2] * z) > limit:
            continue
        n += 1.0
        sx += x
        sy += y
        sz += z
        xx += x * x
        xy += x * y
        xz += x * z
        yy += y * y
        yz += y * z
        zz += z * z
    if n < 4.0:
        moments[0] = n
        return False
    ax, ay, az = sx / n, sy / n, sz / n
    moments[0] = n
    moments[1], moments[2], moments[3] = ox + ax, oy + ay, oz + az
    moments[4], moments[5], moments[6] = xx - n * ax * ax, xy - n * ax * ay, xz - n * ax * az
    moments[7], moments[8], moments[9] = yy - n * ay * ay, yz - n * ay * az, zz - n * az * az
    _, _, _, nx, ny, nz = smallest_axis(
        moments[4] / n, moments[5] / n, moments[6] / n, moments[7] / n, moments[8] / n, moments[9] / n
    )
    if nx * nx + ny * ny + nz * nz < 0.5:
        return False
    plane[0], plane[1], plane[2] = nx, ny, nz
    plane[3], plane[4], plane[5] = moments[1], moments[2], moments[3]
    return True


@njit(cache=True, nogil=True)
def fit_sides(
    points: Array,
    across: Array,
    splits: Array,
    gap_px: float,
    band_px: float,
    spacings: Array,
    limit_m: float,
    least_m: float,
    min_points: int,
) -> tuple[Array, Array, Array]:
    """Fit a plane to each side of each edge, beginning at the edge.

    The plane is looked for in a strip of four point spacings beside the edge, or in the whole band where the strip
    holds no plane, and then followed outwards. Returns (n, 2, 6) normals and points of the planes, (n, 2, 10) moments
    of their points (count, mean, central sums; count 0 where there is no plane), and (n, 2) the distance [m] within
    which points belong to them. Side 0 is the one of the edge's normal.
    """
    n = splits.shape[0] - 1
    planes = np.zeros((n, 2, 6))
    moments = np.zeros((n, 2, 10))
    limits = np.full((n, 2), limit_m)
    for k in range(n):
        first, last = splits[k], splits[k + 1]
        chosen = np.empty(last - first, dtype=np.int64)
        strip = gap_px + max(4.0 * spacings[k], 4.0 * gap_px)
        for side in range(2):
            sign = 1.0 - 2.0 * side
            found = False
            width = strip
            for attempt in range(2):
                width = min(strip, band_px) if attempt == 0 else band_px
                count = 0
                for i in range(first, last):
                    d = sign * across[i]
                    if gap_px <= d <= width:
                        chosen[count] = i
                        count += 1
                if count < min_points:
                    continue
                plane = planes[k, side]
                best = _sampled_plane(points, chosen, count, limit_m, 12345 + 2 * k + side, plane)
                voters = (count + max(1, count // SAMPLE) - 1) // max(1, count // SAMPLE)
                if best >= 0.35 * voters and best * count / voters >= 0.6 * min_points:
                    found = True
                    break
            if not found:
                continue
            limit = limit_m
            good = True
            for attempt in range(ROUNDS):
                if not _refit(points, across, first, last, sign, gap_px, width, limit, planes[k, side], moments[k, side]):
                    good = False
                    break
                m = moments[k, side]
                count_now = m[0]
                nx, ny, nz = planes[k, side, 0], planes[k, side, 1], planes[k, side, 2]
                square = (
                    nx * nx * m[4] + ny * ny * m[7] + nz * nz * m[9]
                    + 2.0 * (nx * ny * m[5] + nx * nz * m[6] + ny * nz * m[8])
                )  # fmt: skip
                spread = math.sqrt(max(square, 0.0) / max(count_now - 3.0, 1.0))
                limit = min(max(TRIM * spread, least_m), limit_m)
                if attempt >= 1:
                    width = min(2.0 * width, band_px)
            limits[k, side] = limit
            if not good or moments[k, side, 0] < min_points:
                moments[k, side, 0] = 0.0
    return planes, moments, limits


@njit(cache=True, nogil=True)
def look_near_edges(
    points: Array,
    along: Array,
    across: Array,
    splits: Array,
    first_px: Array,
    last_px: Array,
    gap_px: float,
    spacings: Array,
    planes: Array,
    moments: Array,
    limits: Array,
    limit_m: float,
) -> tuple[Array, Array, Array, Array]:
    """Count what lies near the edges.

    Returns (n, 2) the share of the edge along which each side's plane has points within two spacings beyond the gap;
    (n, 2) how many points lie within one and a half spacings beyond the gap on each side; (n, 2, 2) for each side's
    plane (first index) how many of these lie on it, by side (second index); and (n, 2) how many, those in the gap
    included, lie in front of each side's plane, towards the camera, and not on the other side's plane. Normals of
    planes must point to the camera.
    """
    n = splits.shape[0] - 1
    covered = np.zeros((n, 2))
    total = np.zeros((n, 2))
    on = np.zeros((n, 2, 2))
    front = np.zeros((n, 2))
    for k in range(n):
        length = last_px[k] - first_px[k]
        bins = int(min(max(length / max(3.0 * spacings[k], 2.0), 1.0), 64.0))
        near = gap_px + 2.0 * spacings[k]
        zone = gap_px + 1.5 * spacings[k]
        hit = np.zeros((2, bins), dtype=np.bool_)
        for i in range(splits[k], splits[k + 1]):
            d = abs(across[i])
            if d > near:
                continue
            lies = 0 if across[i] > 0.0 else 1
            if gap_px <= d <= zone:
                total[k, lies] += 1.0
            heights = (np.inf, np.inf)
            if moments[k, 0, 0] > 0.0:
                heights = (_height(points, i, planes[k, 0]), heights[1])
            if moments[k, 1, 0] > 0.0:
                heights = (heights[0], _height(points, i, planes[k, 1]))
            for side in range(2):
                own = heights[side]
                if own == np.inf:
                    continue
                if abs(own) <= limits[k, side]:
                    if lies == side:
                        hit[side, min(int((along[i] - first_px[k]) / length * bins), bins - 1)] = True
                    if gap_px <= d <= zone:
                        on[k, side, lies] += 1.0
                elif d <= zone and own > limit_m and abs(heights[1 - side]) > limits[k, 1 - side]:
                    front[k, side] += 1.0
        for side in range(2):
            covered[k, side] = np.sum(hit[side]) / bins
    return covered, total, on, front


@njit(cache=True, nogil=True)
def _height(points: Array, i: int, plane: Array) -> float:
    """Give the signed distance of a point from a plane (normal, point)."""
    return (
        plane[0] * (points[i, 0] - plane[3])
        + plane[1] * (points[i, 1] - plane[4])
        + plane[2] * (points[i, 2] - plane[5])
    )


@njit(cache=True, nogil=True)
def sum_patches(
    points: Array,
    along: Array,
    across: Array,
    splits: Array,
    first_px: Array,
    last_px: Array,
    gap_px: float,
    sides: Array,
    normals: Array,
    centroids: Array,
    bases: Array,
    limits: Array,
    rows: Array,
    columns: Array,
    widths_px: Array,
) -> Array:
    """Sum the points of planes by patches, `columns` along the edge and `rows` across each side.

    `sides` (n, 2) tells which sides belong to the plane. Returns (n, 2 * most rows * most columns, 5): count, u, v, r,
    r², in the plane's coordinates.
    """
    n = splits.shape[0] - 1
    most = int(np.max(rows * columns)) if n else 0
    out = np.zeros((n, 2 * most, 5))
    for k in range(n):
        length = last_px[k] - first_px[k]
        for i in range(splits[k], splits[k + 1]):
            d = across[i]
            side = 0 if d > 0.0 else 1
            if not sides[k, side] or abs(d) < gap_px:
                continue
            u = v = r = 0.0
            for a in range(3):
                x = points[i, a] - centroids[k, a]
                u += x * bases[k, a, 0]
                v += x * bases[k, a, 1]
                r += x * normals[k, a]
            if abs(r) > limits[k]:
                continue
            column = min(int((along[i] - first_px[k]) / length * columns[k]), columns[k] - 1)
            row = min(int((abs(d) - gap_px) / widths_px[k] * rows[k]), rows[k] - 1)
            s = out[k, (side * rows[k] + row) * columns[k] + column]
            s[0] += 1.0
            s[1] += u
            s[2] += v
            s[3] += r
            s[4] += r * r
    return out
