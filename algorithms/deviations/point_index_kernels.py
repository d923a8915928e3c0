"""Compiled loops over sorted points: which lie in a sphere, which in a cylinder."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array
from algorithms.scans.normals_kernels import smallest_axis
from algorithms.scans.voxel_grid_kernels import BITS, EMPTY, find

LARGEST = (1 << BITS) - 1
"""Largest number of a cell along an axis."""


@njit(cache=True, nogil=True)
def sorted_by_cell(cell_of_point: Array, cells: int) -> tuple[Array, Array]:
    """Count points into cells: first point of each cell (cells + 1,), and the points in the order of cells (n,)."""
    starts = np.zeros(cells + 1, dtype=np.int64)
    for i in range(cell_of_point.shape[0]):
        starts[cell_of_point[i] + 1] += 1
    for c in range(cells):
        starts[c + 1] += starts[c]
    places = starts[:-1].copy()
    order = np.empty(cell_of_point.shape[0], dtype=np.int64)
    for i in range(cell_of_point.shape[0]):
        c = cell_of_point[i]
        order[places[c]] = i
        places[c] += 1
    return starts, order


@njit(cache=True, nogil=True)
def cell_at(ix: int, iy: int, iz: int, table: Array) -> int:
    """Give the number of a cell, -1 where no point is."""
    if ix < 0 or iy < 0 or iz < 0 or ix > LARGEST or iy > LARGEST or iz > LARGEST:
        return EMPTY
    key = (np.int64(ix) << (2 * BITS)) | (np.int64(iy) << BITS) | np.int64(iz)
    slot = find(key, table)
    return int(table[slot, 1]) if table[slot, 0] == key else EMPTY


@njit(cache=True, nogil=True)
def _reach(offset: float, radius: float, size: float) -> tuple[int, int]:
    """Give the first and last cell that a sphere reaches along an axis, from its centre's offset."""
    return math.floor((offset - radius) / size), math.floor((offset + radius) / size)


@njit(cache=True, nogil=True)
def sphere_moments(
    centre: Array, radius: float, points: Array, starts: Array, moments: Array, table: Array, lower: Array,
    size: float, out: Array,
) -> None:  # fmt: skip
    """Write the moments of all points within a sphere: count, sums about its centre, sums of products (10,).

    Cells that lie within as a whole are added by their moments, exactly and without visiting their points.
    """
    out[:] = 0.0
    fx, fy, fz = centre[0] - lower[0], centre[1] - lower[1], centre[2] - lower[2]
    x0, x1 = _reach(fx, radius, size)
    y0, y1 = _reach(fy, radius, size)
    z0, z1 = _reach(fz, radius, size)
    square = radius * radius
    for ix in range(x0, x1 + 1):
        ax, bx = ix * size - fx, (ix + 1) * size - fx
        near_x = max(ax, 0.0, -bx)
        far_x = max(abs(ax), abs(bx))
        for iy in range(y0, y1 + 1):
            ay, by = iy * size - fy, (iy + 1) * size - fy
            near_y = max(ay, 0.0, -by)
            far_y = max(abs(ay), abs(by))
            for iz in range(z0, z1 + 1):
                az, bz = iz * size - fz, (iz + 1) * size - fz
                near_z = max(az, 0.0, -bz)
                if near_x * near_x + near_y * near_y + near_z * near_z > square:
                    continue
                cell = cell_at(ix, iy, iz, table)
                if cell < 0:
                    continue
                far_z = max(abs(az), abs(bz))
                # a hundredth of a millionth smaller: a point on the rim is judged by itself
                if far_x * far_x + far_y * far_y + far_z * far_z < square * (1.0 - 1e-8):
                    row = moments[cell]
                    n = row[0]
                    x, y, z = row[1] - centre[0], row[2] - centre[1], row[3] - centre[2]
                    out[0] += n
                    out[1] += n * x
                    out[2] += n * y
                    out[3] += n * z
                    out[4] += row[4] + n * x * x
                    out[5] += row[5] + n * x * y
                    out[6] += row[6] + n * x * z
                    out[7] += row[7] + n * y * y
                    out[8] += row[8] + n * y * z
                    out[9] += row[9] + n * z * z
                    continue
                for i in range(starts[cell], starts[cell + 1]):
                    x, y, z = points[i, 0] - centre[0], points[i, 1] - centre[1], points[i, 2] - centre[2]
                    if x * x + y * y + z * z <= square:
                        out[0] += 1.0
                        out[1] += x
                        out[2] += y
                        out[3] += z
                        out[4] += x * x
                        out[5] += x * y
                        out[6] += x * z
                        out[7] += y * y
                        out[8] += y * z
                        out[9] += z * z


@njit(cache=True, nogil=True)
def normals_at(
    centres: Array, radius: float, points: Array, starts: Array, moments: Array, table: Array, lower: Array,
    size: float, start: int, end: int, normals: Array, planarity: Array,
) -> None:  # fmt: skip
    """Fit a plane to the points within a sphere about each centre; the more planar of this and an earlier one stays.

    Writes normals (k, 3) of either sign, and planarity (k,) (l2 - l1) / l3 of the eigenvalues in ascending order.
    """
    m = np.empty(10)
    for k in range(start, end):
        sphere_moments(centres[k], radius, points, starts, moments, table, lower, size, m)
        n = m[0]
        if n < 3.0:
            continue
        x, y, z = m[1] / n, m[2] / n, m[3] / n
        l1, l2, l3, nx, ny, nz = smallest_axis(
            m[4] / n - x * x, m[5] / n - x * y, m[6] / n - x * z,
            m[7] / n - y * y, m[8] / n - y * z, m[9] / n - z * z,
        )  # fmt: skip
        if l3 <= 0.0 or nx * nx + ny * ny + nz * nz < 0.5:
            continue
        found = (l2 - max(l1, 0.0)) / l3
        if found > planarity[k]:
            planarity[k] = found
            normals[k, 0], normals[k, 1], normals[k, 2] = nx, ny, nz


@njit(cache=True, nogil=True)
def _put(buffer: Array, count: int, value: float) -> Array:
    """Write a value behind the others, in a buffer twice as large where it is full."""
    if count == buffer.shape[0]:
        wider = np.empty(2 * count)
        wider[:count] = buffer
        buffer = wider
    buffer[count] = value
    return buffer


@njit(cache=True, nogil=True)
def heights_in_cylinder(  # noqa: C901 - one compiled loop
    core: Array, normal: Array, radius: float, half: float, points: Array, starts: Array, table: Array, lower: Array,
    size: float, buffer: Array,
) -> tuple[Array, int]:  # fmt: skip
    """Collect how far along the axis the points of a cylinder lie from its middle.

    Slab by slab of cells across the axis of coordinates that the cylinder's axis follows most, only the cells that it
    can reach in each. Returns the buffer, which may have grown, and how many of its entries count.
    """
    a = 0
    for k in range(1, 3):
        if abs(normal[k]) > abs(normal[a]):
            a = k
    b, c = (a + 1) % 3, (a + 2) % 3
    na, nb, nc = normal[a], normal[b], normal[c]
    oa, ob, oc = core[a] - lower[a], core[b] - lower[b], core[c] - lower[c]
    aside_a = radius * math.sqrt(max(1.0 - na * na, 0.0))
    aside_b = radius * math.sqrt(max(1.0 - nb * nb, 0.0))
    aside_c = radius * math.sqrt(max(1.0 - nc * nc, 0.0))
    square = radius * radius
    count = 0
    cell_index = np.empty(3, dtype=np.int64)
    first, last = _reach(oa, half * abs(na) + aside_a, size)
    for ia in range(first, last + 1):
        t0 = (ia * size - oa - aside_a) / na
        t1 = ((ia + 1) * size - oa + aside_a) / na
        low, high = max(min(t0, t1), -half), min(max(t0, t1), half)
        if low > high:
            continue
        b0 = math.floor((ob + min(low * nb, high * nb) - aside_b) / size)
        b1 = math.floor((ob + max(low * nb, high * nb) + aside_b) / size)
        c0 = math.floor((oc + min(low * nc, high * nc) - aside_c) / size)
        c1 = math.floor((oc + max(low * nc, high * nc) + aside_c) / size)
        cell_index[a] = ia
        for ib in range(b0, b1 + 1):
            cell_index[b] = ib
            for ic in range(c0, c1 + 1):
                cell_index[c] = ic
                cell = cell_at(cell_index[0], cell_index[1], cell_index[2], table)
                if cell < 0:
                    continue
                for i in range(starts[cell], starts[cell + 1]):
                    x, y, z = points[i, 0] - core[0], points[i, 1] - core[1], points[i, 2] - core[2]
                    t = x * normal[0] + y * normal[1] + z * normal[2]
                    if abs(t) > half:
                        continue
                    x, y, z = x - t * normal[0], y - t * normal[1], z - t * normal[2]
                    if x * x + y * y + z * z <= square:
                        buffer = _put(buffer, count, t)
                        count += 1
    return buffer, count


@njit(cache=True, nogil=True)
def _mean_and_spread(heights: Array) -> tuple[float, float]:
    """Give mean and standard deviation (n - 1); NaN where there are too few."""
    n = heights.shape[0]
    if n == 0:
        return np.nan, np.nan
    mean = 0.0
    for i in range(n):
        mean += heights[i]
    mean /= n
    squares = 0.0
    for i in range(n):
        squares += (heights[i] - mean) ** 2
    return mean, math.sqrt(squares / (n - 1)) if n > 1 else np.nan


@njit(cache=True, nogil=True)
def _quantile(ordered: Array, share: float) -> float:
    """Give a quantile of ascending numbers, linear between neighbours."""
    place = share * (ordered.shape[0] - 1)
    low = int(place)
    high = min(low + 1, ordered.shape[0] - 1)
    return float(ordered[low] + (place - low) * (ordered[high] - ordered[low]))


@njit(cache=True, nogil=True)
def _median_and_spread(heights: Array) -> tuple[float, float]:
    """Give the median, and the interquartile range over that of the standard normal distribution."""
    if heights.shape[0] == 0:
        return np.nan, np.nan
    ordered = np.sort(heights)
    spread = (_quantile(ordered, 0.75) - _quantile(ordered, 0.25)) / 1.3489795003921634
    return _quantile(ordered, 0.5), spread if heights.shape[0] > 1 else np.nan


@njit(cache=True, nogil=True)
def cylinder_sections(
    cores: Array, normals: Array, radius: float, half: float, points: Array, starts: Array, table: Array, lower: Array,
    size: float, use_median: bool, start: int, end: int, out: Array,
) -> None:  # fmt: skip
    """Write position along the axis, spread and number of the points in the cylinder about each core point, (k, 3)."""
    buffer = np.empty(1024)
    for k in range(start, end):
        core, normal = cores[k], normals[k]
        if normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2] < 0.5:
            out[k, 0], out[k, 1], out[k, 2] = np.nan, np.nan, 0.0
            continue
        buffer, count = heights_in_cylinder(
            core, normal, radius, half, points, starts, table, lower, size, buffer
        )  # fmt: skip
        if use_median:
            place, spread = _median_and_spread(buffer[:count])
        else:
            place, spread = _mean_and_spread(buffer[:count])
        out[k, 0], out[k, 1], out[k, 2] = place, spread, count
