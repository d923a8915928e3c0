"""Compiled loops that collect the points beside the edges of a photo."""

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def gather(  # noqa: C901 - one compiled loop
    ideal: Array,
    depths: Array,
    visible: Array,
    starts: Array,
    rows: int,
    columns: int,
    low: Array,
    cell_px: float,
    centres: Array,
    directions: Array,
    first_px: Array,
    last_px: Array,
    band_px: float,
    band_m_px: float,
) -> tuple[Array, Array, Array, Array]:
    """Collect for every edge the visible points beside it.

    Those between `first_px` and `last_px` along the edge, no farther across than `band_px` and, in metres at their own
    depth, than the band (`band_m_px` is its width times the focal length). Returns their numbers, their places along
    and across (positive on the side of the normal), and where each edge's points start.
    """
    n = centres.shape[0]
    room = 4096
    found = np.empty(room, dtype=np.int64)
    along = np.empty(room)
    across = np.empty(room)
    splits = np.zeros(n + 1, dtype=np.int64)
    count = 0
    for k in range(n):
        dx, dy = directions[k, 0], directions[k, 1]
        # rows of cells that the band's rectangle touches, and in each the columns
        x_low, x_high, y_low, y_high = np.inf, -np.inf, np.inf, -np.inf
        for s in (first_px[k], last_px[k]):
            for d in (-band_px, band_px):
                x = centres[k, 0] + s * dx - d * dy
                y = centres[k, 1] + s * dy + d * dx
                x_low, x_high = min(x_low, x), max(x_high, x)
                y_low, y_high = min(y_low, y), max(y_high, y)
        low_row = max(0, int(np.floor((y_low - low[1]) / cell_px)))
        high_row = min(rows - 1, int(np.floor((y_high - low[1]) / cell_px)))
        low_column = max(0, int(np.floor((x_low - low[0]) / cell_px)))
        high_column = min(columns - 1, int(np.floor((x_high - low[0]) / cell_px)))
        middle = 0.5 * (first_px[k] + last_px[k])
        half = 0.5 * (last_px[k] - first_px[k])
        reach = 0.7072 * cell_px
        for row in range(low_row, high_row + 1):
            y = low[1] + (row + 0.5) * cell_px - centres[k, 1]
            for column in range(low_column, high_column + 1):
                x = low[0] + (column + 0.5) * cell_px - centres[k, 0]
                if abs(y * dx - x * dy) > band_px + reach or abs(x * dx + y * dy - middle) > half + reach:
                    continue
                cell = row * columns + column
                for i in range(starts[cell], starts[cell + 1]):
                    if not visible[i]:
                        continue
                    px = ideal[i, 0] - centres[k, 0]
                    py = ideal[i, 1] - centres[k, 1]
                    s = px * dx + py * dy
                    d = py * dx - px * dy
                    if abs(s - middle) > half or abs(d) > band_px or abs(d) * depths[i] > band_m_px:
                        continue
                    if count == room:
                        room *= 2
                        more_found = np.empty(room, dtype=np.int64)
                        more_found[:count] = found
                        found = more_found
                        more_along = np.empty(room)
                        more_along[:count] = along
                        along = more_along
                        more_across = np.empty(room)
                        more_across[:count] = across
                        across = more_across
                    found[count] = i
                    along[count] = s
                    across[count] = d
                    count += 1
        splits[k + 1] = count
    return found[:count], along[:count], across[:count], splits
