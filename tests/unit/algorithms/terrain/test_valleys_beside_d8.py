"""Valleys by rain lie where the common D8 flow has them, on terrain without a known answer."""

import heapq

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from algorithms.deviations.rasters import Grid
from algorithms.terrain.drainage.rain import rain_on
from algorithms.terrain.drainage.structure_lines import valleys

SIDE = 100
LEAST_CELLS, LARGE_CELLS = 150, 300
"""Where the one has a large catchment, the other has at least half of it: neither knows where a valley begins."""
AROUND = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]


def d8_catchments(heights: np.ndarray) -> np.ndarray:
    """Cells whose water runs through each: hollows filled from the border (Barnes et al. 2014), all the water of a cell
    to the steepest of its eight neighbours (O'Callaghan and Mark 1984), on level ground back along the flood."""
    rows, columns = heights.shape
    filled, parent = heights.copy(), np.full((*heights.shape, 2), -1)
    seen = np.zeros(heights.shape, dtype=bool)
    queue = [(heights[i, j], i, j) for i in range(rows) for j in range(columns)
             if i in (0, rows - 1) or j in (0, columns - 1)]  # fmt: skip
    for _, i, j in queue:
        seen[i, j] = True
    heapq.heapify(queue)
    order = []
    while queue:
        height, i, j = heapq.heappop(queue)
        order.append((i, j))
        for k, m in ((i + a, j + b) for a, b in AROUND):
            if 0 <= k < rows and 0 <= m < columns and not seen[k, m]:
                seen[k, m] = True
                filled[k, m] = max(heights[k, m], height)
                parent[k, m] = i, j
                heapq.heappush(queue, (filled[k, m], k, m))
    catchment = np.ones(heights.shape)
    for i, j in reversed(order):
        steepest, to = 0.0, tuple(parent[i, j])
        for a, b in AROUND:
            k, m = i + a, j + b
            if 0 <= k < rows and 0 <= m < columns:
                slope = (filled[i, j] - filled[k, m]) / np.hypot(a, b)
                if slope > steepest:
                    steepest, to = slope, (k, m)
        if to[0] >= 0:
            catchment[to] += catchment[i, j]
    return catchment


def test_valleys_lie_where_d8_has_them() -> None:
    found: list[float] = []
    missed: list[float] = []
    for seed in (1, 2, 3):
        rough = gaussian_filter(np.random.default_rng(seed).normal(size=(SIDE, SIDE)), 6.0, mode="reflect")
        heights = 40.0 * rough / rough.std() * 0.1 + 0.15 * np.arange(SIDE)[:, None]
        grid = Grid(0.0, 0.0, 1.0, SIDE, SIDE)
        rain, catchments = rain_on(heights), d8_catchments(heights).ravel()
        for strong, all_ in ((LARGE_CELLS, LEAST_CELLS), (LEAST_CELLS, LARGE_CELLS)):
            lines = valleys(heights, rain, grid, float(strong), 5.0)
            ours = np.vstack([line.points[:, :2] for line in lines])
            theirs = grid.centres()[catchments >= all_]
            one, other = (ours, theirs) if strong > all_ else (theirs, ours)
            on_water = (rain.filled_m > heights)[one[:, 1].astype(int), one[:, 0].astype(int)]
            apart, _ = cKDTree(other).query(one[~on_water])  # full hollows are level: there water has no direction
            (found if strong > all_ else missed).append(float((apart <= 2.0).mean()))
    print(np.round([found, missed], 3))
    assert min(found) > 0.9  # what rain calls a valley D8 has too
    # D8 never parts the water of a cell: below outlets and on slopes it draws lines where rain spreads out
    assert min(missed) > 0.7
