"""Compiled passes over the points of planes: labelling, sums per plane and per patch, rasters.

Every kernel works on the points from `start` to `end`, so that blocks of points can be worked on at the same time.
`frames` holds a row per plane: normal (3), centroid (3), basis vectors E1 (3) and E2 (3), tolerance (1).
`plane_of_cell` tells which plane the points of a cell may lie on: its number, -1 for none, and -2 - q for those in row
q of `several`.
"""

import numpy as np
from numba import njit

from algorithms.arrays import Array
from algorithms.scans.moments_kernels import NOTHING, with_point


@njit(cache=True, nogil=True)
def _nearest(points: Array, i: int, several: Array, row: int, frames: Array) -> tuple[int, int]:
    """Give the nearest of the planes in a row, -1 for none, and how many hold point i within their tolerance."""
    best = np.inf
    label = -1
    hits = 0
    for k in range(several.shape[1]):
        p = several[row, k]
        if p < 0:
            break
        gap = abs(
            (points[i, 0] - frames[p, 3]) * frames[p, 0]
            + (points[i, 1] - frames[p, 4]) * frames[p, 1]
            + (points[i, 2] - frames[p, 5]) * frames[p, 2]
        )
        if gap > frames[p, 12]:
            continue
        hits += 1
        if gap < best:
            best = gap
            label = p
    return label, hits


@njit(cache=True, nogil=True, inline="always")
def _add(out: Array, p: int, sums: tuple[float, ...]) -> None:
    """Add sums of points to those in row p."""
    for k in range(len(sums)):
        out[p, k] += sums[k]


@njit(cache=True, nogil=True, inline="always")
def _widen(extents: Array, p: int, u_min: float, v_min: float, u_max: float, v_max: float) -> None:
    """Widen the bounding rectangle in row p."""
    extents[p, 0] = min(extents[p, 0], u_min)
    extents[p, 1] = min(extents[p, 1], v_min)
    extents[p, 2] = max(extents[p, 2], u_max)
    extents[p, 3] = max(extents[p, 3], v_max)


@njit(cache=True, nogil=True, inline="always")
def _sums_about(moments: Array, cell: int, frames: Array, p: int) -> tuple[float, ...]:
    """Give the sums of a cell's points about the centroid of plane p: count, coordinates, their products."""
    n = moments[cell, 0]
    x = moments[cell, 1] - frames[p, 3]
    y = moments[cell, 2] - frames[p, 4]
    z = moments[cell, 3] - frames[p, 5]
    return (
        n,
        n * x,
        n * y,
        n * z,
        moments[cell, 4] + n * x * x,
        moments[cell, 5] + n * x * y,
        moments[cell, 6] + n * x * z,
        moments[cell, 7] + n * y * y,
        moments[cell, 8] + n * y * z,
        moments[cell, 9] + n * z * z,
    )


@njit(cache=True, nogil=True, inline="always")
def _mean_square(sums: tuple[float, ...], frames: Array, p: int) -> float:
    """Give the mean of the squares of the distances from plane p, from what `_sums_about` gives."""
    n, _, _, _, xx, xy, xz, yy, yz, zz = sums
    x, y, z = frames[p, 0], frames[p, 1], frames[p, 2]
    total: float = x * (x * xx + 2.0 * (y * xy + z * xz)) + y * (y * yy + 2.0 * z * yz) + z * z * zz
    return total / n


@njit(cache=True, nogil=True)
def part_cells(
    moments: Array, plane_of_cell: Array, frames: Array, share: float, start: int, end: int, whole: Array, parted: Array
) -> None:
    """Write the plane of cells that lie on their only one as a whole into `whole`, that of all others into `parted`.

    The points of the former deviate from it, in the root mean square, by at most `share` of its tolerance. The other
    array gets -1.
    """
    for cell in range(start, end):
        p = plane_of_cell[cell]
        on_plane = False
        if p >= 0:
            square = _mean_square(_sums_about(moments, cell, frames, p), frames, p)
            on_plane = square <= (share * frames[p, 12]) ** 2
        whole[cell] = p if on_plane else -1
        parted[cell] = -1 if on_plane else p


@njit(cache=True, nogil=True)
def points_of_cells(
    points: Array, cell_of_point: Array, plane_of_cell: Array, start: int, end: int
) -> tuple[Array, Array]:
    """Copy the points from `start` to `end` whose cell has a plane, and give the cell of each."""
    which = np.empty(end - start, dtype=np.int32)
    found = 0
    for k in range(end - start):
        cell = cell_of_point[start + k]
        if cell >= 0 and plane_of_cell[cell] != -1:
            which[found] = k
            found += 1
    copied = np.empty((found, 3))
    cells = np.empty(found, dtype=np.int32)
    for k in range(found):
        i = start + which[k]
        cells[k] = cell_of_point[i]
        for a in range(3):
            copied[k, a] = points[i, a]
    return copied, cells


@njit(cache=True, nogil=True)
def sum_cells(moments: Array, plane_of_cell: Array, frames: Array, start: int, end: int) -> Array:
    """Sum the cells from `start` to `end` as `sum_planes` does points: those as near to their plane as its tolerance.

    What counts is the root mean square of the distances of a cell's points.
    """
    out = np.zeros((frames.shape[0], 10))
    for cell in range(start, end):
        p = plane_of_cell[cell]
        if p < 0:
            continue
        sums = _sums_about(moments, cell, frames, p)
        if _mean_square(sums, frames, p) <= frames[p, 12] ** 2:
            _add(out, p, sums)
    return out


@njit(cache=True, nogil=True)
def sum_planes(
    points: Array, cell_of_point: Array, plane_of_cell: Array, several: Array, frames: Array, start: int, end: int
) -> Array:
    """Sum the points nearest to each plane: (k, 10) count, coordinates about its centroid, their products.

    All of them have a cell with a plane.

    Points within the tolerance of two planes are left out: near an edge they belong to both, and must not shape one.
    """
    out = np.zeros((frames.shape[0], 10))
    plane = -1  # sums stay in registers while neighbours in recording order lie on the same plane
    sums = NOTHING
    nx = ny = nz = cx = cy = cz = tolerance = 0.0
    for i in range(start, end):
        p = plane_of_cell[cell_of_point[i]]
        if p < -1:
            p, hits = _nearest(points, i, several, -2 - p, frames)
            if hits != 1:
                continue
        if p != plane:
            if plane >= 0:
                _add(out, plane, sums)
            sums = NOTHING
            plane = p
            nx, ny, nz = frames[p, 0], frames[p, 1], frames[p, 2]
            cx, cy, cz = frames[p, 3], frames[p, 4], frames[p, 5]
            tolerance = frames[p, 12]
        x = points[i, 0] - cx
        y = points[i, 1] - cy
        z = points[i, 2] - cz
        if abs(x * nx + y * ny + z * nz) > tolerance:
            continue
        sums = with_point(sums, x, y, z)
    if plane >= 0:
        _add(out, plane, sums)
    return out


@njit(cache=True, nogil=True)
def label_points(  # noqa: PLR0915 - one compiled loop
    points: Array,
    cell_of_point: Array,
    plane_of_cell: Array,
    several: Array,
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
    plane = -1  # as in `sum_planes`
    count = 0
    sums = NOTHING
    nx = ny = nz = cx = cy = cz = ex = ey = ez = fx = fy = fz = tolerance = 0.0
    u_min = v_min = np.inf
    u_max = v_max = -np.inf
    for i in range(start, end):
        cell = cell_of_point[i]
        p = -1 if cell < 0 else plane_of_cell[cell]
        hits = 1
        if p < -1:
            p, hits = _nearest(points, i, several, -2 - p, frames)
        shared[i] = hits > 1
        if p < 0:
            labels[i] = -1
            continue
        if p != plane:
            if plane >= 0:
                _add(out, plane, sums)
                counts[plane] += count
                _widen(extents, plane, u_min, v_min, u_max, v_max)
            plane = p
            count = 0
            sums = NOTHING
            u_min = v_min = np.inf
            u_max = v_max = -np.inf
            nx, ny, nz = frames[p, 0], frames[p, 1], frames[p, 2]
            cx, cy, cz = frames[p, 3], frames[p, 4], frames[p, 5]
            ex, ey, ez = frames[p, 6], frames[p, 7], frames[p, 8]
            fx, fy, fz = frames[p, 9], frames[p, 10], frames[p, 11]
            tolerance = frames[p, 12]
        x = points[i, 0] - cx
        y = points[i, 1] - cy
        z = points[i, 2] - cz
        if abs(x * nx + y * ny + z * nz) > tolerance:
            labels[i] = -1
            continue
        labels[i] = p
        count += 1
        u = x * ex + y * ey + z * ez
        v = x * fx + y * fy + z * fz
        u_min = min(u_min, u)
        v_min = min(v_min, v)
        u_max = max(u_max, u)
        v_max = max(v_max, v)
        if hits == 1:
            sums = with_point(sums, x, y, z)
    if plane >= 0:
        _add(out, plane, sums)
        counts[plane] += count
        _widen(extents, plane, u_min, v_min, u_max, v_max)
    return out, counts, extents


@njit(cache=True, nogil=True)
def sum_patches(
    points: Array,
    labels: Array,
    shared: Array,
    numbers: Array,
    frames: Array,
    corners: Array,
    per_patch: Array,
    starts: Array,
    rows: Array,
    columns: Array,
    start: int,
    end: int,
) -> Array:
    """Sum unshared points per rectangular patch of every plane: (patches, 5) count, u, v, residual, squared residual.

    `numbers` gives the plane of each label, -1 for none; `corners` (k, 2) is where the patches of a plane begin, and
    `per_patch` (k, 2) the reciprocal of their sizes.
    """
    out = np.zeros((starts[-1], 5))
    plane = patch = -1  # frame and sums stay in registers, as in `sum_planes`
    n = su = sv = sr = srr = 0.0
    cx = cy = cz = nx = ny = nz = ex = ey = ez = fx = fy = fz = u_min = v_min = per_u = per_v = 0.0
    first = height = width = 0
    for i in range(start, end):
        if labels[i] < 0 or shared[i]:
            continue
        p = numbers[labels[i]]
        if p < 0:
            continue
        if p != plane:
            plane = p
            nx, ny, nz = frames[p, 0], frames[p, 1], frames[p, 2]
            cx, cy, cz = frames[p, 3], frames[p, 4], frames[p, 5]
            ex, ey, ez = frames[p, 6], frames[p, 7], frames[p, 8]
            fx, fy, fz = frames[p, 9], frames[p, 10], frames[p, 11]
            u_min, v_min = corners[p, 0], corners[p, 1]
            per_u, per_v = per_patch[p, 0], per_patch[p, 1]
            first, height, width = starts[p], rows[p], columns[p]
        x = points[i, 0] - cx
        y = points[i, 1] - cy
        z = points[i, 2] - cz
        r = x * nx + y * ny + z * nz
        u = x * ex + y * ey + z * ez
        v = x * fx + y * fy + z * fz
        # points at the rim may lie outside by rounding and by the tilt since the rectangle was measured
        column = min(max(int((u - u_min) * per_u), 0), width - 1)
        row = min(max(int((v - v_min) * per_v), 0), height - 1)
        s = first + row * width + column
        if s != patch:
            if patch >= 0:
                _add(out, patch, (n, su, sv, sr, srr))
            n = su = sv = sr = srr = 0.0
            patch = s
        n += 1.0
        su += u
        sv += v
        sr += r
        srr += r * r
    if patch >= 0:
        _add(out, patch, (n, su, sv, sr, srr))
    return out


@njit(cache=True, nogil=True)
def patch_systems(
    sums: Array, starts: Array, frames: Array, noise: Array, sensor: Array, steady: float, least_cosine: float
) -> tuple[Array, Array, Array, Array]:
    """Give the equations of the occupied patches of all planes.

    The error of a range shows across the plane with the cosine of the incidence: a floor is noisy below the instrument
    and quiet far away, where it fixes the tilt best. So the noise of a plane is shared out among its patches, one on
    the average of the points, unless `sensor` is not known (nan); never less than the square of `least_cosine`. The
    scatter of a patch itself counts besides as many points as `steady` says.

    Returns
    -------
    Derivatives of a patch's offset by (a1, a2, b) (p, 3); mean offsets (p,) [m]; variances of these (p,) [m2]; and
    where the patches of each plane begin, (k + 1,).
    """
    k = frames.shape[0]
    jacobian = np.empty((sums.shape[0], 3))
    misfits = np.empty(sums.shape[0])
    variances = np.empty(sums.shape[0])
    splits = np.zeros(k + 1, dtype=np.int64)
    shares = np.empty(sums.shape[0])
    known = not np.isnan(sensor[0])
    row = 0
    for p in range(k):
        total = 0.0
        shared = 0.0
        for s in range(starts[p], starts[p + 1]):
            n = sums[s, 0]
            if n == 0.0:
                continue
            u, v = sums[s, 1] / n, sums[s, 2] / n
            share = 1.0
            if known:
                across = 0.0
                square = 0.0
                for a in range(3):
                    ray = frames[p, 3 + a] + u * frames[p, 6 + a] + v * frames[p, 9 + a] - sensor[a]
                    across += ray * frames[p, a]
                    square += ray * ray
                share = across * across / max(square, 1e-18) + least_cosine**2
            shares[s] = share
            total += n
            shared += n * share
        for s in range(starts[p], starts[p + 1]):
            n = sums[s, 0]
            if n == 0.0:
                continue
            mean = sums[s, 3] / n
            within = sums[s, 4] - n * mean * mean
            expected = noise[p] ** 2 * shares[s] * total / shared
            jacobian[row, 0] = -sums[s, 1] / n
            jacobian[row, 1] = -sums[s, 2] / n
            jacobian[row, 2] = 1.0
            misfits[row] = mean
            variances[row] = (within + steady * expected) / (n - 1.0 + steady) / n + 1e-18
            row += 1
        splits[p + 1] = row
    return jacobian[:row], misfits[:row], variances[:row], splits


@njit(cache=True, nogil=True)
def fill_rasters(
    points: Array,
    labels: Array,
    numbers: Array,
    frames: Array,
    origins: Array,
    per_cell: Array,
    starts: Array,
    rows: Array,
    columns: Array,
    border: int,
    cell_of_point: Array,
    spread: Array,
    start: int,
    end: int,
    out: Array,
) -> None:
    """Mark the occupied raster cells of every plane in one flat uint8 array; every block writes the same mark.

    `per_cell` (k,) is the reciprocal of the size of the raster cells. Points of scan cells with a `spread` mark all
    within it, up to the border; there may be none with one, an empty array then.
    """
    plane = -1  # its frame stays in registers, as in `sum_planes`
    cx = cy = cz = ex = ey = ez = fx = fy = fz = u_min = v_min = per = 0.0
    first = height = width = 0
    for i in range(start, end):
        if labels[i] < 0:
            continue
        p = numbers[labels[i]]
        if p < 0:
            continue
        if p != plane:
            plane = p
            cx, cy, cz = frames[p, 3], frames[p, 4], frames[p, 5]
            ex, ey, ez = frames[p, 6], frames[p, 7], frames[p, 8]
            fx, fy, fz = frames[p, 9], frames[p, 10], frames[p, 11]
            u_min, v_min, per = origins[p, 0], origins[p, 1], per_cell[p]
            first, height, width = starts[p], rows[p], columns[p]
        x = points[i, 0] - cx
        y = points[i, 1] - cy
        z = points[i, 2] - cz
        v = (x * fx + y * fy + z * fz - v_min) * per
        u = (x * ex + y * ey + z * ez - u_min) * per
        row = min(max(int(v), 0), height - 1)
        column = min(max(int(u), 0), width - 1)
        out[first + row * width + column] = 1
        if spread.shape[0] == 0 or spread[cell_of_point[i]] == 0.0:
            continue
        reach = spread[cell_of_point[i]] * per
        for r in range(max(int(v - reach), border), min(int(v + reach), height - 1 - border) + 1):
            for c in range(max(int(u - reach), border), min(int(u + reach), width - 1 - border) + 1):
                out[first + r * width + c] = 1


@njit(cache=True, nogil=True)
def unlabelled(labels: Array, numbers: Array, cell_of_point: Array, start: int, end: int) -> Array:
    """List the points from `start` to `end` that are in a cell but on no plane; `numbers` as for `sum_patches`."""
    out = np.empty(end - start, dtype=np.int64)
    found = 0
    for i in range(start, end):
        if cell_of_point[i] >= 0 and (labels[i] < 0 or numbers[labels[i]] < 0):
            out[found] = i
            found += 1
    return out[:found].copy()
