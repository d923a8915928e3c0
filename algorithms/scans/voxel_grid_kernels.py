"""Compiled loops of the voxel grid: hashing points into cells and finding the neighbours of a cell."""

import numpy as np
from numba import njit

from algorithms.arrays import Array

EMPTY = -1
"""Mark of a free place in the hash table."""
BITS = 20
"""Bits of one voxel coordinate in the 60-bit key."""


@njit(cache=True, nogil=True)
def bounds(points: Array) -> tuple[Array, Array]:
    """Give the smallest and largest coordinates of points, (3,) each: faster than reducing along the long axis."""
    low = points[0].copy()
    high = points[0].copy()
    for i in range(points.shape[0]):
        for a in range(3):
            low[a] = min(low[a], points[i, a])
            high[a] = max(high[a], points[i, a])
    return low, high


@njit(cache=True, nogil=True)
def _slot(key: np.int64, mask: int) -> np.int64:
    """Spread a key over the table (Fibonacci hashing)."""
    h = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    return np.int64((h >> np.uint64(20)) & np.uint64(mask))


@njit(cache=True, nogil=True)
def _rehash(keys: Array, count: int, capacity: int) -> Array:
    """Build a table of cell numbers for the first `count` keys."""
    table = np.full(capacity, EMPTY, dtype=np.int32)
    mask = capacity - 1
    for cell in range(count):
        slot = _slot(keys[cell], mask)
        while table[slot] != EMPTY:
            slot = (slot + 1) & mask
        table[slot] = cell
    return table


@njit(cache=True, nogil=True)
def hash_points(points: Array, lower: Array, size: float) -> tuple[Array, Array, Array, Array]:  # noqa: PLR0915 - one compiled loop
    """Put points into voxels and sum their moments.

    Returns cell of each point (n,), keys (m,), hash table, and moments (m, 10): count, sums of coordinates relative to
    the voxel's centre, and sums of their products (xx, xy, xz, yy, yz, zz).
    """
    n = points.shape[0]
    inverse = 1.0 / size
    cell_of_point = np.empty(n, dtype=np.int32)
    room = 1 << 12
    keys = np.empty(room, dtype=np.int64)
    moments = np.zeros((room, 10))
    table = np.full(4 * room, EMPTY, dtype=np.int32)
    mask = 4 * room - 1
    count = 0
    last_key = np.int64(-1)
    cell = 0
    for i in range(n):
        ix = np.int64((points[i, 0] - lower[0]) * inverse)
        iy = np.int64((points[i, 1] - lower[1]) * inverse)
        iz = np.int64((points[i, 2] - lower[2]) * inverse)
        key = (ix << (2 * BITS)) | (iy << BITS) | iz
        if key != last_key:  # neighbours in recording order mostly share the voxel
            last_key = key
            slot = _slot(key, mask)
            while table[slot] != EMPTY and keys[table[slot]] != key:
                slot = (slot + 1) & mask
            if table[slot] != EMPTY:
                cell = table[slot]
            else:
                if count == room:
                    wider_keys = np.empty(2 * room, dtype=np.int64)
                    wider_keys[:room] = keys
                    wider_moments = np.zeros((2 * room, 10))
                    wider_moments[:room] = moments
                    keys = wider_keys
                    moments = wider_moments
                    room *= 2
                    table = _rehash(keys, count, 4 * room)
                    mask = 4 * room - 1
                    slot = _slot(key, mask)
                    while table[slot] != EMPTY:
                        slot = (slot + 1) & mask
                cell = count
                keys[cell] = key
                table[slot] = cell
                count += 1
        cell_of_point[i] = cell
        x = points[i, 0] - (lower[0] + (ix + 0.5) * size)
        y = points[i, 1] - (lower[1] + (iy + 0.5) * size)
        z = points[i, 2] - (lower[2] + (iz + 0.5) * size)
        m = moments[cell]
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
    return cell_of_point, keys[:count].copy(), table, moments[:count].copy()


@njit(cache=True, nogil=True)
def centre_moments(moments: Array, keys: Array, lower: Array, size: float) -> None:
    """Turn sums about the voxel centres into count, mean and central sums of products, in place."""
    low_bits = (1 << BITS) - 1
    for cell in range(moments.shape[0]):
        m = moments[cell]
        key = keys[cell]
        n = m[0]
        x = m[1] / n
        y = m[2] / n
        z = m[3] / n
        m[4] -= n * x * x
        m[5] -= n * x * y
        m[6] -= n * x * z
        m[7] -= n * y * y
        m[8] -= n * y * z
        m[9] -= n * z * z
        m[1] = x + lower[0] + ((key >> (2 * BITS)) + 0.5) * size
        m[2] = y + lower[1] + (((key >> BITS) & low_bits) + 0.5) * size
        m[3] = z + lower[2] + ((key & low_bits) + 0.5) * size


@njit(cache=True, nogil=True)
def voxel_neighbours(keys: Array, table: Array) -> Array:
    """Find the up to 26 touching cells of every cell, (m, 26) int32, -1 where there is none."""
    mask = table.shape[0] - 1
    neighbours = np.full((keys.shape[0], 26), -1, dtype=np.int32)
    for cell in range(keys.shape[0]):
        for k in range(13):  # the other half is the mirror image
            step = k + 14
            dx = step // 9 - 1
            dy = (step // 3) % 3 - 1
            dz = step % 3 - 1
            key = keys[cell] + (np.int64(dx) << (2 * BITS)) + (np.int64(dy) << BITS) + dz
            slot = _slot(key, mask)
            while table[slot] != EMPTY:
                other = table[slot]
                if keys[other] == key:
                    neighbours[cell, k] = other
                    neighbours[other, 25 - k] = cell
                    break
                slot = (slot + 1) & mask
    return neighbours
