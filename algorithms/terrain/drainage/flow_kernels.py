"""Compiled passes over cells: flooding from the border, and water that runs to lower neighbours.

Cells are numbered row by row; each has four neighbours.
"""

import heapq

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def _neighbour(cell: int, side: int, rows: int, columns: int) -> int:
    """Give one of the four neighbours (east, west, next row, previous row), -1 beyond the border."""
    r = cell // columns
    c = cell % columns
    if side == 0:
        return cell + 1 if c + 1 < columns else -1
    if side == 1:
        return cell - 1 if c > 0 else -1
    if side == 2:
        return cell + columns if r + 1 < rows else -1
    return cell - columns if r > 0 else -1


@njit(cache=True, nogil=True)
def flood(heights: Array) -> tuple[Array, Array, Array]:
    """Fill hollows up to their lowest rim, from the border inwards (priority flood, Barnes and others 2014).

    Cells at the border, or beside a gap (NaN), let water out.

    Returns
    -------
    Filled heights, the cells in the order in which water would reach them from outside, and for each cell the one it
    was reached from (-1 at an outlet).
    """
    rows, columns = heights.shape
    flat = heights.ravel()
    total = flat.size
    filled = flat.copy()
    seen = np.isnan(flat)
    parents = np.full(total, -1, np.int64)
    order = np.empty(total, np.int64)
    count = 0
    heap = [(0.0, 0, 0)]
    heap.clear()
    turn = 0
    for cell in range(total):
        if np.isnan(flat[cell]):
            continue
        for side in range(4):
            other = _neighbour(cell, side, rows, columns)
            if other < 0 or np.isnan(flat[other]):
                heapq.heappush(heap, (flat[cell], turn, cell))
                turn += 1
                seen[cell] = True
                break
    while len(heap) > 0:
        height, _, cell = heapq.heappop(heap)
        order[count] = cell
        count += 1
        for side in range(4):
            other = _neighbour(cell, side, rows, columns)
            if other < 0 or seen[other]:
                continue
            seen[other] = True
            parents[other] = cell
            filled[other] = max(flat[other], height)
            heapq.heappush(heap, (filled[other], turn, other))
            turn += 1
    return filled.reshape(rows, columns), order[:count], parents


@njit(cache=True, nogil=True)
def _drop(flat: Array, cell: int, side: int, rows: int, columns: int) -> float:
    """Give how much lower a neighbour lies; beyond the border the slope goes on as from the opposite side."""
    other = _neighbour(cell, side, rows, columns)
    if other >= 0 and not np.isnan(flat[other]):
        return float(flat[cell] - flat[other])
    opposite = _neighbour(cell, side ^ 1, rows, columns)
    if opposite >= 0 and not np.isnan(flat[opposite]):
        return float(flat[opposite] - flat[cell])
    return 0.0


@njit(cache=True, nogil=True)
def shares_of(filled: Array, parents: Array) -> tuple[Array, Array]:
    """Give the shares (cells, 4) in which each cell's water runs to its neighbours, and where most of it runs (cells,).

    To lower neighbours in proportion to the slope; where none is lower, as on filled hollows, all to the cell from
    which it was flooded. Shares that run over the border are lost: those of a cell then add up to less than 1.
    """
    rows, columns = filled.shape
    flat = filled.ravel()
    shares = np.zeros((flat.size, 4))
    main = np.full(flat.size, -1, np.int64)
    for cell in range(flat.size):
        if np.isnan(flat[cell]):
            continue
        total = 0.0
        largest = 0.0
        for side in range(4):
            drop = _drop(flat, cell, side, rows, columns)
            if drop > 0.0:
                other = _neighbour(cell, side, rows, columns)
                inside = other >= 0 and not np.isnan(flat[other])
                total += drop
                if inside:
                    shares[cell, side] = drop
                if drop > largest:
                    largest = drop
                    main[cell] = other if inside else -1
        if total > 0.0:
            shares[cell] /= total
        else:
            main[cell] = parents[cell]
            for side in range(4):
                shares[cell, side] = 1.0 if 0 <= parents[cell] == _neighbour(cell, side, rows, columns) else 0.0
    return shares, main


@njit(cache=True, nogil=True)
def rain_once(shares: Array, runoff: Array, columns: int) -> Array:
    """Rain one unit on each cell that holds `runoff`, and give what runs into each cell then."""
    rows = len(runoff) // columns
    out = np.zeros(len(runoff))
    for cell in range(len(runoff)):
        for side in range(4):
            if shares[cell, side] > 0.0:
                out[_neighbour(cell, side, rows, columns)] += shares[cell, side] * (1.0 + runoff[cell])
    return out


@njit(cache=True, nogil=True)
def settled_runoff(shares: Array, order: Array, columns: int) -> Array:
    """Give what runs into each cell when it has rained for ever: cells from the last flooded to the first."""
    rows = len(shares) // columns
    runoff = np.zeros(len(shares))
    for k in range(len(order) - 1, -1, -1):
        cell = order[k]
        for side in range(4):
            if shares[cell, side] > 0.0:
                runoff[_neighbour(cell, side, rows, columns)] += shares[cell, side] * (1.0 + runoff[cell])
    return runoff
