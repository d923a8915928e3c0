"""Compiled loops of the voxel grid: hashing points into cells and finding the neighbours of a cell."""

from typing import Any

import numpy as np
from numba import njit

from algorithms.arrays import Array

EMPTY = -1
"""Mark of a free place in the hash table."""
BITS = 20
"""Bits of one voxel coordinate in the 60-bit key."""


@njit(cache=True, nogil=True)
def bounds(points: Array, start: int, end: int) -> tuple[Array, Array]:
    """Give the smallest and largest coordinates of the points from `start` to `end`, (3,) each."""
    low = points[start].copy()
    high = points[start].copy()
    for i in range(start, end):
        for a in range(3):
            low[a] = min(low[a], points[i, a])
            high[a] = max(high[a], points[i, a])
    return low, high


@njit(cache=True, nogil=True)
def _slot(key: np.int64, mask: int) -> np.int64:
    """Spread a key over the table: multiplied and folded twice (as in SplitMix64), for x, y and z all to count."""
    h = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    h = (h ^ (h >> np.uint64(32))) * np.uint64(0xBF58476D1CE4E5B9)
    return np.int64((h >> np.uint64(32)) & np.uint64(mask))


@njit(cache=True, nogil=True)
def find(key: np.int64, table: Array) -> np.int64:
    """Give the row of the table that holds the key, or the free one where it belongs."""
    mask = table.shape[0] - 1
    slot = _slot(key, mask)
    while table[slot, 0] != EMPTY and table[slot, 0] != key:
        slot = (slot + 1) & mask
    return slot


@njit(cache=True, nogil=True)
def table_of(keys: Array, count: int, capacity: int) -> Array:
    """Build a hash table, (capacity, 2) key and number, of the first `count` keys; both share a line of the cache."""
    table = np.full((capacity, 2), EMPTY, dtype=np.int64)
    for cell in range(count):
        slot = find(keys[cell], table)
        table[slot, 0] = keys[cell]
        table[slot, 1] = cell
    return table


HALVES, HALF_BIT = 2, 1 << 30
"""Voxels are counted in halves, by a bit of their keys' hashes that no table reaches."""
BATCH = 64
"""Points whose voxels are looked up together."""


@njit(cache=True, nogil=True)
def hash_points(
    points: Array, lower: Array, size: float, start: int, end: int, cell_of_point: Array
) -> tuple[Array, Array]:
    """Put the points from `start` to `end` into voxels and sum their moments.

    Points in random order find neither table nor sums in the cache. So they are looked up in batches, in short loops
    whose loads do not wait for each other: a third of the time.

    Writes the voxel of each point, numbered in the order in which they appear. Returns keys (m,) and moments (m, 10):
    count, sums of coordinates relative to the voxel's centre, and sums of their products (xx, xy, xz, yy, yz, zz).
    """
    room = 1 << 12
    keys = np.empty(room, dtype=np.int64)
    moments = np.zeros((room, 10))
    table = table_of(keys, 0, 2 * room)
    count = 0
    own_keys = np.empty(BATCH, dtype=np.int64)
    slots = np.empty(BATCH, dtype=np.int64)
    cells = np.empty(BATCH, dtype=np.int64)
    offsets = np.empty((BATCH, 3))
    fetched = np.empty(1)
    for first in range(start, end, BATCH):
        batch = min(BATCH, end - first)
        _locate(points, first, batch, lower, size, table.shape[0] - 1, own_keys, slots, offsets)
        for j in range(batch):
            cells[j] = table[slots[j], 1] if table[slots[j], 0] == own_keys[j] else EMPTY
        for j in range(batch):
            if cells[j] == EMPTY:
                slot = find(own_keys[j], table)
                if table[slot, 0] == EMPTY:
                    if count == room:
                        keys, moments = _doubled(keys, moments)
                        room *= 2
                        table = table_of(keys, count, 2 * room)
                        slot = find(own_keys[j], table)
                    keys[count] = own_keys[j]
                    table[slot, 0] = own_keys[j]
                    table[slot, 1] = count
                    count += 1
                cells[j] = table[slot, 1]
            cell_of_point[first + j] = cells[j]
        _add(moments, cells, offsets, batch, fetched)
    return keys[:count].copy(), moments[:count].copy()


@njit(cache=True, nogil=True)
def _room_for(count: int) -> int:
    """Give the capacity of a hash table of at most `count` keys: a power of two."""
    capacity = 2
    while capacity < 2 * count:
        capacity *= 2
    return capacity


@njit(cache=True, nogil=True)
def _key(points: Array, row: int, lower: Array, inverse: float) -> np.int64:
    """Give the key of the voxel that holds a point."""
    ix = np.int64((points[row, 0] - lower[0]) * inverse)
    iy = np.int64((points[row, 1] - lower[1]) * inverse)
    iz = np.int64((points[row, 2] - lower[2]) * inverse)
    return (ix << (2 * BITS)) | (iy << BITS) | iz


@njit(cache=True, nogil=True)
def count_points(points: Array, lower: Array, size: float, half: int) -> Any:  # pragma: no cover - compiled
    """Count the points of every voxel of one half, 0 or 1, of all: (m,) int64, in the order of a hash table."""
    n = points.shape[0]
    table = table_of(np.empty(0, dtype=np.int64), 0, max(_room_for(n) // HALVES, 2))
    inverse = 1.0 / size
    for i in range(n):
        key = _key(points, i, lower, inverse)
        if _slot(key, HALF_BIT) != half * HALF_BIT:
            continue
        slot = find(key, table)
        if table[slot, 0] == EMPTY:
            table[slot, 0], table[slot, 1] = key, 0
        table[slot, 1] += 1
    return table[table[:, 0] != EMPTY, 1]


@njit(cache=True, nogil=True)
def _locate(
    points: Array,
    first: int,
    batch: int,
    lower: Array,
    size: float,
    mask: int,
    keys: Array,
    slots: Array,
    offsets: Array,
) -> None:
    """Write for a batch of points the keys of their voxels, where to look first, and offsets from the centres."""
    inverse = 1.0 / size
    for j in range(batch):
        x = points[first + j, 0] - lower[0]
        y = points[first + j, 1] - lower[1]
        z = points[first + j, 2] - lower[2]
        ix = np.int64(x * inverse)
        iy = np.int64(y * inverse)
        iz = np.int64(z * inverse)
        keys[j] = (ix << (2 * BITS)) | (iy << BITS) | iz
        slots[j] = _slot(keys[j], mask)
        offsets[j, 0] = x - (ix + 0.5) * size
        offsets[j, 1] = y - (iy + 0.5) * size
        offsets[j, 2] = z - (iz + 0.5) * size


@njit(cache=True, nogil=True)
def _add(moments: Array, cells: Array, offsets: Array, batch: int, fetched: Array) -> None:
    """Add a batch of points to the moments of their voxels."""
    touched = 0.0
    for j in range(batch):  # brings all that is needed into the cache at once
        touched += moments[cells[j], 0] + moments[cells[j], 9]
    fetched[0] = touched  # or else the compiler leaves the loop out
    for j in range(batch):
        cell = cells[j]
        x = offsets[j, 0]
        y = offsets[j, 1]
        z = offsets[j, 2]
        moments[cell, 0] += 1.0
        moments[cell, 1] += x
        moments[cell, 2] += y
        moments[cell, 3] += z
        moments[cell, 4] += x * x
        moments[cell, 5] += x * y
        moments[cell, 6] += x * z
        moments[cell, 7] += y * y
        moments[cell, 8] += y * z
        moments[cell, 9] += z * z


@njit(cache=True, nogil=True)
def _doubled(keys: Array, moments: Array) -> tuple[Array, Array]:
    """Make room for as many voxels again."""
    room = len(keys)
    wider_keys = np.empty(2 * room, dtype=np.int64)
    wider_keys[:room] = keys
    wider_moments = np.zeros((2 * room, 10))
    wider_moments[:room] = moments
    return wider_keys, wider_moments


@njit(cache=True, nogil=True)
def unite(keys: Array, moments: Array, more_keys: Array, more_moments: Array) -> tuple[Array, Array, Array]:
    """Add the voxels of a later block of points to those of earlier ones; new ones take the next numbers.

    Returns keys and moments of all, and the number among them of each voxel of the later block.
    """
    m = len(keys)
    table = table_of(keys, m, _room_for(m + len(more_keys)))
    numbers = np.empty(len(more_keys), dtype=np.int32)
    fresh = 0
    for i in range(len(more_keys)):
        slot = find(more_keys[i], table)
        if table[slot, 0] == EMPTY:
            numbers[i] = m + fresh
            fresh += 1
        else:
            numbers[i] = table[slot, 1]
    all_keys = np.empty(m + fresh, dtype=np.int64)
    all_moments = np.empty((m + fresh, 10))
    all_keys[:m] = keys
    all_moments[:m] = moments
    for i in range(len(more_keys)):
        cell = numbers[i]
        if cell < m:
            all_moments[cell] += more_moments[i]
        else:
            all_keys[cell] = more_keys[i]
            all_moments[cell] = more_moments[i]
    return all_keys, all_moments, numbers


@njit(cache=True, nogil=True)
def renumber(cell_of_point: Array, numbers: Array, start: int, end: int) -> None:
    """Give the points from `start` to `end` the new numbers of their voxels."""
    for i in range(start, end):
        cell_of_point[i] = numbers[cell_of_point[i]]


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
def voxel_neighbours(keys: Array, table: Array, start: int, end: int, neighbours: Array) -> None:
    """Enter the touching pairs of cells, the first from `start` to `end`, into (m, 26) int32 that is full of -1.

    Every cell looks for half of its neighbours and enters itself at theirs, so no place is written twice.
    """
    for cell in range(start, end):
        for k in range(13):  # the other half is the mirror image
            step = k + 14
            dx = step // 9 - 1
            dy = (step // 3) % 3 - 1
            dz = step % 3 - 1
            key = keys[cell] + (np.int64(dx) << (2 * BITS)) + (np.int64(dy) << BITS) + dz
            slot = find(key, table)
            if table[slot, 0] == key:
                other = table[slot, 1]
                neighbours[cell, k] = other
                neighbours[other, 25 - k] = cell


@njit(cache=True, nogil=True)
def fullest(points: Array, lower: Array, size: float, counts: Array) -> Any:  # pragma: no cover - compiled
    """Give the point of the largest count in every voxel, of equals the first: (voxels,) int64, in no order."""
    n = points.shape[0]
    table = table_of(np.empty(0, dtype=np.int64), 0, _room_for(n))
    inverse = 1.0 / size
    for i in range(n):
        key = _key(points, i, lower, inverse)
        slot = find(key, table)
        if table[slot, 0] == EMPTY:
            table[slot, 0], table[slot, 1] = key, i
        elif counts[i] > counts[table[slot, 1]]:
            table[slot, 1] = i
    return table[table[:, 0] != EMPTY, 1]


@njit(cache=True, nogil=True)
def first_of_each(keys: Array) -> Array:
    """Give where each key, none negative, occurs first: ascending, int64."""
    n = keys.shape[0]
    table = table_of(keys, 0, _room_for(n))
    out = np.empty(n, dtype=np.int64)
    count = 0
    for i in range(n):
        slot = find(keys[i], table)
        if table[slot, 0] == EMPTY:
            table[slot, 0] = keys[i]
            out[count] = i
            count += 1
    return out[:count].copy()
