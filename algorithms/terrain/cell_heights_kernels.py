"""Compiled loops over the cells of height grids."""

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def lowest_in_cells(cells: Array, heights: Array, count: int) -> Array:
    """Give the number of the lowest point in each of `count` cells, -1 for none; cells below 0 are left out."""
    out = np.full(count, -1, np.int64)
    for i in range(len(cells)):
        cell = cells[i]
        if cell >= 0 and (out[cell] < 0 or heights[i] < heights[out[cell]]):
            out[cell] = i
    return out


@njit(cache=True, nogil=True)
def quantiles_in_cells(cells: Array, heights: Array, count: int, share: float) -> Array:
    """Give the height below which a share of the points of each of `count` cells lies, NaN for none; O(n log n)."""
    starts = np.zeros(count + 1, np.int64)
    for cell in cells:
        starts[cell + 1] += 1
    starts = np.cumsum(starts)
    filled = starts[:-1].copy()
    sorted_ = np.empty(len(heights))
    for i in range(len(cells)):
        sorted_[filled[cells[i]]] = heights[i]
        filled[cells[i]] += 1
    out = np.full(count, np.nan)
    for cell in range(count):
        n = starts[cell + 1] - starts[cell]
        if n > 0:
            out[cell] = np.sort(sorted_[starts[cell] : starts[cell + 1]])[int(share * (n - 1))]
    return out


@njit(cache=True, nogil=True)
def relax_gaps(values: Array, known: Array, sweeps: int, factor: float) -> float:
    """Relax the membrane over unknown cells in place (successive over-relaxation); give the largest last change."""
    rows, columns = values.shape
    largest = 0.0
    for _ in range(sweeps):
        largest = 0.0
        for r in range(rows):
            for c in range(columns):
                if known[r, c]:
                    continue
                total = 0.0
                count = 0
                if r > 0:
                    total += values[r - 1, c]
                    count += 1
                if r + 1 < rows:
                    total += values[r + 1, c]
                    count += 1
                if c > 0:
                    total += values[r, c - 1]
                    count += 1
                if c + 1 < columns:
                    total += values[r, c + 1]
                    count += 1
                if count == 0:
                    continue
                change = factor * (total / count - values[r, c])
                values[r, c] += change
                largest = max(largest, abs(change))
    return largest


@njit(cache=True, nogil=True)
def raise_membrane(surface: Array, ceiling: Array, lift: float, sweeps: int, factor: float) -> None:
    """Draw a membrane up in place, never above a ceiling (projected successive over-relaxation).

    In equilibrium a free cell lies `lift` / 4 above the mean of its four neighbours; the border has none outside.
    """
    rows, columns = surface.shape
    for _ in range(sweeps):
        for r in range(rows):
            for c in range(columns):
                # beyond the border lies what is inside it
                up = surface[r - 1, c] if r > 0 else surface[r, c]
                down = surface[r + 1, c] if r + 1 < rows else surface[r, c]
                left = surface[r, c - 1] if c > 0 else surface[r, c]
                right = surface[r, c + 1] if c + 1 < columns else surface[r, c]
                goal = 0.25 * (up + down + left + right + lift)
                surface[r, c] = min(surface[r, c] + factor * (goal - surface[r, c]), ceiling[r, c])
