"""Compiled loops that cut the grid of a structured scan into blocks of pixels."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array
from algorithms.scans.moments_kernels import NOTHING, with_point, write_central

TILE = 64
"""Blocks are visited in squares of so many: whether a scan was recorded by rows or by columns, its points are near."""
STEPS = ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1))
"""From a block to its neighbours: rows, columns."""


@njit(cache=True, nogil=True)
def occupied_blocks(index: Array, mixed: Array, block: int, first_row: int, end_row: int, out: Array) -> None:
    """Write 0 for blocks, of some rows of blocks, that hold a point which is not mixed, and -1 for the others."""
    rows, columns = index.shape
    for bi in range(first_row, end_row):
        out[bi] = -1
        for i in range(bi * block, min(rows, (bi + 1) * block)):
            j = 0
            for bj in range(out.shape[1]):
                end = min(columns, j + block)
                found = False
                while j < end:
                    found = found or (index[i, j] >= 0 and not mixed[i, j])
                    j += 1
                if found:
                    out[bi, bj] = 0


@njit(cache=True, nogil=True)
def number_blocks(blocks: Array) -> int:
    """Give the blocks that are not -1 numbers, row by row, and tell how many there are."""
    count = 0
    for bi in range(blocks.shape[0]):
        for bj in range(blocks.shape[1]):
            if blocks[bi, bj] >= 0:
                blocks[bi, bj] = count
                count += 1
    return count


@njit(cache=True, nogil=True)
def _middle(values: Array, count: int) -> float:
    """Give the upper median of the first few values, which are sorted in place."""
    for i in range(1, count):
        value = values[i]
        k = i
        while k > 0 and values[k - 1] > value:
            values[k] = values[k - 1]
            k -= 1
        values[k] = value
    return float(values[count // 2])


@njit(cache=True, nogil=True)
def block_moments(
    points: Array,
    index: Array,
    mixed: Array,
    ranges: Array,
    cell_of_block: Array,
    block: int,
    depth: float,
    least_depth: float,
    first_row: int,
    end_row: int,
    cell_of_point: Array,
    moments: Array,
) -> None:
    """Sum the moments of blocks of block x block pixels, for some rows of blocks.

    A block keeps the points whose range is within `depth` times the middle range plus `least_depth` of the middle one:
    a block at a depth edge stands for one of the two surfaces. Writes the cell of each point, -1 where left out, and
    the moments: count, mean, central sums of products.
    """
    rows, columns = index.shape
    own = np.empty(block * block)
    for top in range(first_row, end_row, TILE):
        for left in range(0, cell_of_block.shape[1], TILE):
            for bi in range(top, min(top + TILE, end_row)):
                for bj in range(left, min(left + TILE, cell_of_block.shape[1])):
                    cell = cell_of_block[bi, bj]
                    if cell < 0:
                        continue
                    window = (bi * block, min(rows, (bi + 1) * block), bj * block, min(columns, (bj + 1) * block))
                    # first as if all were one surface, which is mostly so
                    low, high = _add_block(
                        points, index, mixed, ranges, window, 0.0, np.inf, cell, cell_of_point, moments
                    )
                    if high - low <= depth * low + least_depth:
                        continue
                    found = 0
                    for i in range(window[0], window[1]):
                        for j in range(window[2], window[3]):
                            if index[i, j] >= 0 and not mixed[i, j]:
                                own[found] = ranges[i, j]
                                found += 1
                    middle = _middle(own, found)
                    gate = depth * middle + least_depth
                    _add_block(points, index, mixed, ranges, window, middle, gate, cell, cell_of_point, moments)


@njit(cache=True, nogil=True)
def _add_block(
    points: Array,
    index: Array,
    mixed: Array,
    ranges: Array,
    window: tuple[int, int, int, int],
    middle: float,
    gate: float,
    cell: int,
    cell_of_point: Array,
    moments: Array,
) -> tuple[float, float]:
    """Write the moments of the pixels in a window (rows, columns) that are within the gate; give the range's bounds."""
    low = np.inf
    high = 0.0
    sums = NOTHING
    ox = oy = oz = 0.0
    for i in range(window[0], window[1]):
        for j in range(window[2], window[3]):
            p = index[i, j]
            if p < 0:
                continue
            if mixed[i, j] or abs(ranges[i, j] - middle) > gate:
                cell_of_point[p] = -1
                continue
            low = min(low, ranges[i, j])
            high = max(high, ranges[i, j])
            cell_of_point[p] = cell
            if sums[0] == 0.0:
                ox, oy, oz = points[p, 0], points[p, 1], points[p, 2]
            x = points[p, 0] - ox
            y = points[p, 1] - oy
            z = points[p, 2] - oz
            sums = with_point(sums, x, y, z)
    write_central(sums, ox, oy, oz, moments[cell])
    return low, high


@njit(cache=True, nogil=True)
def block_neighbours(
    moments: Array,
    cell_of_block: Array,
    sensor: Array,
    step_rad: float,
    slope: float,
    least_jump: float,
    first_row: int,
    end_row: int,
    neighbours: Array,
    spacing: Array,
) -> None:
    """Link blocks that touch in the grid and in space, for some rows of blocks.

    Two blocks are linked when the difference of their ranges is no more than a surface of the given slope shows over
    their distance across the ray, and that distance is no more than three blocks; so the last column, or row, is linked
    to the first only where the scan goes full circle. Writes (m, 8) neighbours, -1 where there is none, and (m,) the
    mean distance of each cell from its linked neighbours.
    """
    block_rows, block_columns = cell_of_block.shape
    for bi in range(first_row, end_row):
        for bj in range(block_columns):
            cell = cell_of_block[bi, bj]
            if cell < 0:
                continue
            neighbours[cell] = -1
            spacing[cell] = 0.0
            x = moments[cell, 1] - sensor[0]
            y = moments[cell, 2] - sensor[1]
            z = moments[cell, 3] - sensor[2]
            r = math.sqrt(x * x + y * y + z * z)
            if r <= 0.0:
                continue
            total = 0.0
            links = 0
            for k in range(8):
                step_i, step_j = STEPS[k]
                # around the circle by comparisons, which are quicker than remainders
                ni = bi + step_i
                ni = ni + block_rows if ni < 0 else ni - block_rows if ni >= block_rows else ni
                nj = bj + step_j
                nj = nj + block_columns if nj < 0 else nj - block_columns if nj >= block_columns else nj
                other = cell_of_block[ni, nj]
                if other < 0 or other == cell:
                    continue
                dx = moments[other, 1] - moments[cell, 1]
                dy = moments[other, 2] - moments[cell, 2]
                dz = moments[other, 3] - moments[cell, 3]
                along = (dx * x + dy * y + dz * z) / r
                square = dx * dx + dy * dy + dz * dz
                across = math.sqrt(max(square - along * along, 0.0))
                if across > 3.0 * r * step_rad or abs(along) > slope * across + least_jump:
                    continue
                neighbours[cell, k] = other
                total += math.sqrt(square)
                links += 1
            if links > 0:
                spacing[cell] = total / links
