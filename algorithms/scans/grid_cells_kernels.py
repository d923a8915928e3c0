"""Compiled loops that cut the grid of a structured scan into blocks of pixels."""

import math

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def block_moments(  # noqa: PLR0915 - one compiled loop
    points: Array, index: Array, mixed: Array, sensor: Array, block: int, depth: float, least_depth: float
) -> tuple[Array, Array, Array]:
    """Sum the moments of blocks of block x block pixels.

    A block keeps the points whose range is within `depth` times the middle range plus `least_depth` of the middle one:
    a block at a depth edge stands for one of the two surfaces. Returns cell of each point (n,), -1 where left out;
    moments (m, 10): count, mean, central sums of products; and the cell of each block (block rows, block columns).
    """
    rows, columns = index.shape
    block_rows = (rows + block - 1) // block
    block_columns = (columns + block - 1) // block
    cell_of_point = np.full(points.shape[0], -1, dtype=np.int32)
    moments = np.zeros((block_rows * block_columns, 10))
    cell_of_block = np.full((block_rows, block_columns), -1, dtype=np.int32)
    members = np.empty(block * block, dtype=np.int64)
    ranges = np.empty(block * block)
    count = 0
    for bi in range(block_rows):
        for bj in range(block_columns):
            found = 0
            for i in range(bi * block, min(rows, (bi + 1) * block)):
                for j in range(bj * block, min(columns, (bj + 1) * block)):
                    p = index[i, j]
                    if p < 0 or mixed[i, j]:
                        continue
                    x = points[p, 0] - sensor[0]
                    y = points[p, 1] - sensor[1]
                    z = points[p, 2] - sensor[2]
                    members[found] = p
                    ranges[found] = math.sqrt(x * x + y * y + z * z)
                    found += 1
            if found == 0:
                continue
            middle = np.sort(ranges[:found])[found // 2]
            gate = depth * middle + least_depth
            m = moments[count]
            origin = members[0]
            for k in range(found):
                if abs(ranges[k] - middle) > gate:
                    continue
                p = members[k]
                x = points[p, 0] - points[origin, 0]
                y = points[p, 1] - points[origin, 1]
                z = points[p, 2] - points[origin, 2]
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
                cell_of_point[p] = count
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
            m[1] = x + points[origin, 0]
            m[2] = y + points[origin, 1]
            m[3] = z + points[origin, 2]
            cell_of_block[bi, bj] = count
            count += 1
    return cell_of_point, moments[:count].copy(), cell_of_block


@njit(cache=True, nogil=True)
def block_neighbours(  # noqa: C901 - one compiled loop
    moments: Array, cell_of_block: Array, sensor: Array, step_rad: float, slope: float, least_jump: float
) -> tuple[Array, Array]:
    """Link blocks that touch in the grid and in space.

    Two blocks are linked when the difference of their ranges is no more than a surface of the given slope shows over
    their distance across the ray, and that distance is no more than three blocks; so the last column is linked to the
    first only where the scan goes full circle. Returns (m, 8) neighbours, -1 where there is none, and (m,) the mean
    distance of each cell from its linked neighbours.
    """
    block_rows, block_columns = cell_of_block.shape
    m = moments.shape[0]
    neighbours = np.full((m, 8), -1, dtype=np.int32)
    spacing = np.zeros(m)
    for bi in range(block_rows):
        for bj in range(block_columns):
            cell = cell_of_block[bi, bj]
            if cell < 0:
                continue
            x = moments[cell, 1] - sensor[0]
            y = moments[cell, 2] - sensor[1]
            z = moments[cell, 3] - sensor[2]
            r = math.sqrt(x * x + y * y + z * z)
            if r <= 0.0:
                continue
            total = 0.0
            links = 0
            for k in range(9):
                if k == 4:
                    continue
                ni = bi + k // 3 - 1
                if ni < 0 or ni >= block_rows:
                    continue
                other = cell_of_block[ni, (bj + k % 3 - 1) % block_columns]
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
                neighbours[cell, k if k < 4 else k - 1] = other
                total += math.sqrt(square)
                links += 1
            if links > 0:
                spacing[cell] = total / links
    return neighbours, spacing
