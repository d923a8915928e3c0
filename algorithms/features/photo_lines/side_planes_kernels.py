"""Compiled loops that find the plane on each side of an edge, and what else is near the edge."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array
from algorithms.scans.moments_kernels import NOTHING, with_point, write_central
from algorithms.scans.normals_kernels import smallest_axis

TRIPLES = 80
"""Planes through three points tried on each side."""
SAMPLE = 240
"""Points of a side that vote for them."""
TRIM = 3.5
"""Points farther from the plane than so many standard deviations do not belong to it."""
ROUNDS = 7
"""Fits of each plane; the last two without the rims."""
LEAST_VOTES = 0.35
"""Least share of the points, those at its limit counting less, for a plane."""
PARALLEL_COSINE = 0.995
"""Edges within six degrees run along each other."""
FLAT_COSINE = 0.985
"""Edges that cross at less than ten degrees are close to each other for long."""
SAME_PX = 0.3
"""Edges nearer to each other than this are one."""
ZONE = 1.25
"""Right beside an edge means within so many spacings beyond the gap."""
NEAR = 1.25
"""A surface that reaches an edge has points within so many spacings beyond the gap."""
PRESENT = 0.3
"""A plane that holds less of the points of a cell does not pass there."""
PURE = 0.8
"""Cells of which less lies on the plane hold something else as well."""


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
def _refit(points: Array, first: int, last: int, wanted: Array, limit: float, plane: Array, moments: Array) -> bool:
    """Fit the plane anew to the wanted points within `limit` of it: moments = count, mean, central sums."""
    ox, oy, oz = plane[3], plane[4], plane[5]
    sums = NOTHING
    for i in range(first, last):
        if not wanted[i - first]:
            continue
        x, y, z = points[i, 0] - ox, points[i, 1] - oy, points[i, 2] - oz
        if abs(plane[0] * x + plane[1] * y + plane[2] * z) > limit:
            continue
        sums = with_point(sums, x, y, z)
    n = moments[0] = sums[0]
    if n < 4.0:
        return False
    write_central(sums, ox, oy, oz, moments)
    _, _, _, nx, ny, nz = smallest_axis(
        moments[4] / n, moments[5] / n, moments[6] / n, moments[7] / n, moments[8] / n, moments[9] / n
    )
    if nx * nx + ny * ny + nz * nz < 0.5:
        return False
    plane[0], plane[1], plane[2] = nx, ny, nz
    plane[3], plane[4], plane[5] = moments[1], moments[2], moments[3]
    return True


@njit(cache=True, nogil=True)
def _spread(plane: Array, m: Array) -> float:
    """Give the standard deviation of points across their plane."""
    nx, ny, nz = plane[0], plane[1], plane[2]
    square = nx * nx * m[4] + ny * ny * m[7] + nz * nz * m[9] + 2.0 * (nx * ny * m[5] + nx * nz * m[6] + ny * nz * m[8])
    return math.sqrt(max(square, 0.0) / max(m[0] - 3.0, 1.0))


@njit(cache=True, nogil=True)
def _height(points: Array, i: int, plane: Array) -> float:
    """Give the signed distance of a point from a plane (normal, point)."""
    height: float = plane[0] * (points[i, 0] - plane[3])
    height += plane[1] * (points[i, 1] - plane[4]) + plane[2] * (points[i, 2] - plane[5])
    return height


@njit(cache=True, nogil=True)
def _leave_rims_out(  # noqa: C901 - one compiled loop
    points: Array, along: Array, across: Array, first: int, last: int, sign: float, gap: float, start: float,
    cell: float, limit: float, plane: Array, wanted: Array,
) -> None:  # fmt: skip
    """Keep the points of cells that hold hardly anything but the plane, and whose neighbours do as well.

    Where another surface joins the plane, its first points lie within the limit, all on one side of it, and beams that
    hit both surfaces do too: they would tilt the plane. The row beside the edge has no neighbours on the other side.
    Where less than half of the points would be left, only impure cells go, or nothing. Points beyond cells that hold
    nothing of the plane lie on another body, even if in the same plane, or nearly: they go first.
    """
    s_high = d_high = 0.0
    for i in range(first, last):
        s_high = max(s_high, along[i] - start)
        d_high = max(d_high, sign * across[i] - gap)
    columns, rows = int(s_high / cell) + 1, int(d_high / cell) + 1
    all_points, on_plane = np.zeros((rows, columns)), np.zeros((rows, columns))
    for i in range(first, last):
        d = sign * across[i] - gap
        if d >= 0.0:
            row, column = int(d / cell), int((along[i] - start) / cell)
            all_points[row, column] += 1.0
            if abs(_height(points, i, plane)) <= limit:
                on_plane[row, column] += 1.0
    for i in range(first, last):
        d = sign * across[i] - gap
        if wanted[i - first] and not _reached(all_points, on_plane, int(d / cell), int((along[i] - start) / cell)):
            wanted[i - first] = False
    impure = on_plane < PURE * all_points
    for reach in (1, 0):
        kept = total = 0
        for i in range(first, last):
            d = sign * across[i] - gap
            if wanted[i - first] and abs(_height(points, i, plane)) <= limit:
                total += 1
                kept += not _near_impure(impure, int(d / cell), int((along[i] - start) / cell), reach)
        if kept < 0.5 * total:
            continue
        for i in range(first, last):
            d = sign * across[i] - gap
            if wanted[i - first] and _near_impure(impure, int(d / cell), int((along[i] - start) / cell), reach):
                wanted[i - first] = False
        return


@njit(cache=True, nogil=True)
def _reached(all_points: Array, on_plane: Array, row: int, column: int) -> bool:
    """Tell whether the plane is seen from its first cell beside the edge to a cell, without two missing in a row."""
    begun, missing = False, 0
    for r in range(row):
        if on_plane[r, column] > 0.0 and on_plane[r, column] >= PRESENT * all_points[r, column]:
            begun, missing = True, 0
        else:
            missing += 1
        if begun and missing == 2:
            return False
    return True


@njit(cache=True, nogil=True)
def _near_impure(impure: Array, row: int, column: int, reach: int) -> bool:
    """Tell whether a cell or one up to `reach` beside it is impure."""
    for r in range(max(0, row - reach), min(impure.shape[0], row + reach + 1)):
        for c in range(max(0, column - reach), min(impure.shape[1], column + reach + 1)):
            if impure[r, c]:
                return True
    return False


@njit(cache=True, nogil=True)
def fit_sides(  # noqa: C901 - one compiled loop
    points: Array,
    along: Array,
    across: Array,
    splits: Array,
    first_px: Array,
    gap_px: float,
    band_px: float,
    spacings: Array,
    limit_m: float,
    least_m: float,
    min_points: int,
) -> tuple[Array, Array, Array, Array]:
    """Fit a plane to each side of each edge, beginning at the edge.

    The plane is looked for in a strip of four point spacings beside the edge, or in the whole band where the strip
    holds no plane, and then followed outwards. Returns (n, 2, 6) normals and points of the planes, (n, 2, 10) moments
    of their points (count, mean, central sums; count 0 where there is no plane), (n, 2) the distance [m] within which
    points belong to them, and (m,) which points made the plane of their side. Side 0 is the one of the edge's normal.
    """
    n = splits.shape[0] - 1
    planes = np.zeros((n, 2, 6))
    moments = np.zeros((n, 2, 10))
    limits = np.full((n, 2), limit_m)
    used = np.zeros(points.shape[0], dtype=np.bool_)
    for k in range(n):
        first, last = splits[k], splits[k + 1]
        wanted = np.zeros(last - first, dtype=np.bool_)
        strip = gap_px + max(4.0 * spacings[k], 4.0 * gap_px)
        for side in range(2):
            sign = 1.0 - 2.0 * side
            plane, own = planes[k, side], moments[k, side]
            width = _first_plane(
                points, across, first, last, sign, gap_px, min(strip, band_px), band_px, limit_m, min_points,
                12345 + 2 * k + side, plane,
            )  # fmt: skip
            if width == 0.0:
                continue
            limit = limit_m
            good = True
            for attempt in range(ROUNDS):
                if attempt < ROUNDS - 2:
                    for i in range(first, last):
                        wanted[i - first] = gap_px <= sign * across[i] <= width
                elif attempt == ROUNDS - 2:
                    cell = max(2.0 * spacings[k], gap_px)
                    _leave_rims_out(
                        points, along, across, first, last, sign, gap_px, first_px[k], cell, limit, plane, wanted
                    )
                if not _refit(points, first, last, wanted, limit, plane, own):
                    good = False
                    break
                limit = min(max(TRIM * _spread(plane, own), least_m), limit_m)
                if attempt >= 1:
                    width = min(2.0 * width, band_px)
            limits[k, side] = limit
            if not good or own[0] < min_points:
                own[0] = 0.0
                continue
            for i in range(first, last):
                if wanted[i - first] and abs(_height(points, i, plane)) <= limit:
                    used[i] = True
    return planes, moments, limits, used


@njit(cache=True, nogil=True)
def _first_plane(
    points: Array, across: Array, first: int, last: int, sign: float, gap: float, strip: float, band: float,
    limit: float, min_points: int, state: int, plane: Array,
) -> float:  # fmt: skip
    """Find a plane in the strip beside the edge, or else in the whole band: the width looked at, 0 without a plane."""
    chosen = np.empty(last - first, dtype=np.int64)
    for width in (strip, band):
        count = 0
        for i in range(first, last):
            if gap <= sign * across[i] <= width:
                chosen[count] = i
                count += 1
        if count < min_points:
            continue
        step = max(1, count // SAMPLE)
        voters = (count + step - 1) // step
        best = _sampled_plane(points, chosen, count, limit, state, plane)
        if best >= LEAST_VOTES * voters and best * count / voters >= 0.6 * min_points:
            return width
    return 0.0


@njit(cache=True, nogil=True)
def look_near_edges(  # noqa: C901, PLR0912 - one compiled loop
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

    Returns (n, 2) the share of the edge along which each side's plane has points within `NEAR` spacings beyond the gap;
    (n, 2) how many points lie within `ZONE` spacings beyond the gap; (n, 2, 2) for each side's
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
        near = gap_px + NEAR * spacings[k]
        zone = gap_px + ZONE * spacings[k]
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
def sum_patches(
    points: Array,
    along: Array,
    across: Array,
    splits: Array,
    first_px: Array,
    last_px: Array,
    gap_px: float,
    used: Array,
    sides: Array,
    normals: Array,
    centroids: Array,
    bases: Array,
    rows: Array,
    columns: Array,
    widths_px: Array,
    sensor: Array,
) -> Array:
    """Sum the used points of planes by patches, `columns` along the edge and `rows` across each side.

    `sides` (n, 2) tells which sides belong to the plane. Returns (n, 2 * most rows * most columns, 5): count, u, v, r,
    r², in the plane's coordinates. u and v are where the ray from the sensor meets the plane: the error of a range
    moves the point along the plane as well, and would tilt narrow planes if its place were taken from the point.
    """
    n = splits.shape[0] - 1
    most = int(np.max(rows * columns)) if n else 0
    out = np.zeros((n, 2 * most, 5))
    for k in range(n):
        length = last_px[k] - first_px[k]
        for i in range(splits[k], splits[k + 1]):
            d = across[i]
            side = 0 if d > 0.0 else 1
            if not (used[i] and sides[k, side]):
                continue
            u = v = r = u_ray = v_ray = r_ray = 0.0
            for a in range(3):
                x, ray = points[i, a] - centroids[k, a], points[i, a] - sensor[a]
                u += x * bases[k, a, 0]
                v += x * bases[k, a, 1]
                r += x * normals[k, a]
                u_ray += ray * bases[k, a, 0]
                v_ray += ray * bases[k, a, 1]
                r_ray += ray * normals[k, a]
            if abs(r_ray) > 1e-9:
                u -= r / r_ray * u_ray
                v -= r / r_ray * v_ray
            column = min(int((along[i] - first_px[k]) / length * columns[k]), columns[k] - 1)
            row = min(int((abs(d) - gap_px) / widths_px[k] * rows[k]), rows[k] - 1)
            s = out[k, (side * rows[k] + row) * columns[k] + column]
            s[0] += 1.0
            s[1] += u
            s[2] += v
            s[3] += r
            s[4] += r * r
    return out


@njit(cache=True, nogil=True)
def crowded_sides(centres: Array, directions: Array, extents: Array, reaches: Array) -> Array:
    """Tell on which sides (n, 2) of edges another edge runs along them within `reaches` (n,), for a third or more."""
    n = centres.shape[0]
    crowded = np.zeros((n, 2), dtype=np.bool_)
    for k in range(n):
        dx, dy = directions[k, 0], directions[k, 1]
        low, high = extents[k, 0], extents[k, 1]
        for j in range(n):
            if j == k or abs(dx * directions[j, 0] + dy * directions[j, 1]) < PARALLEL_COSINE:
                continue
            x, y = centres[j, 0] - centres[k, 0], centres[j, 1] - centres[k, 1]
            ax, ay = x + extents[j, 0] * directions[j, 0], y + extents[j, 0] * directions[j, 1]
            bx, by = x + extents[j, 1] * directions[j, 0], y + extents[j, 1] * directions[j, 1]
            sa, sb = ax * dx + ay * dy, bx * dx + by * dy
            start, end = max(low, min(sa, sb)), min(high, max(sa, sb))
            if end - start < (high - low) / 3.0:
                continue
            da, db = ay * dx - ax * dy, by * dx - bx * dy
            d = da + (db - da) * (0.5 * (start + end) - sa) / (sb - sa)
            if SAME_PX < abs(d) <= reaches[k]:
                crowded[k, 0 if d > 0.0 else 1] = True
    return crowded


@njit(cache=True, nogil=True)
def flatly_crossed(centres: Array, directions: Array, extents: Array, reach: float) -> Array:
    """Tell which edges (n,) another one meets at a flat angle, and is nearer than `reach` along a quarter of them."""
    n = centres.shape[0]
    crossed = np.zeros(n, dtype=np.bool_)
    for k in range(n):
        dx, dy = directions[k, 0], directions[k, 1]
        low, high = extents[k, 0], extents[k, 1]
        for j in range(n):
            cosine = abs(dx * directions[j, 0] + dy * directions[j, 1])
            if j == k or not FLAT_COSINE < cosine < PARALLEL_COSINE:
                continue
            x, y = centres[j, 0] - centres[k, 0], centres[j, 1] - centres[k, 1]
            along, across = x * dx + y * dy, y * dx - x * dy
            slope = (directions[j, 1] * dx - directions[j, 0] * dy) / (directions[j, 0] * dx + directions[j, 1] * dy)
            first = along + extents[j, 0] * (directions[j, 0] * dx + directions[j, 1] * dy)
            last = along + extents[j, 1] * (directions[j, 0] * dx + directions[j, 1] * dy)
            start, end = max(low, min(first, last)), min(high, max(first, last))
            # where the other edge is within reach: across + slope (s - along) = ± reach
            meeting, half = along - across / slope, reach / abs(slope)
            if min(end, meeting + half) - max(start, meeting - half) >= 0.25 * (high - low):
                crossed[k] = True
                break
    return crossed
