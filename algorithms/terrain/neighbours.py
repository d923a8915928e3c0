"""Points sorted into square cells, so that neighbours in plan are found at once."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Indices, Points
from algorithms.deviations.rasters import Grid
from algorithms.terrain.cell_heights import cells_over


@dataclass(frozen=True, eq=False)
class PointCells:
    """Which points lie in which cell."""

    grid: Grid
    cells: Indices
    """(n,) cell of each point."""
    order: Array
    """(n,) numbers of the points, cell after cell."""
    starts: Array
    """(cells + 1,) where each begins in `order`."""

    def lowest(self, points: Points) -> Array:
        """Give the least height of each cell [m]; infinity where there is none."""
        out = np.full(len(self.starts) - 1, np.inf)
        filled = np.flatnonzero(np.diff(self.starts) > 0)
        out[filled] = np.minimum.reduceat(points[self.order, 2], self.starts[filled])
        return out


def sorted_into_cells(points: Points, edge_m: float) -> PointCells:
    """Sort points into square cells; O(n log n)."""
    grid = cells_over(points, edge_m)
    cells = grid.cells_of(points)
    counts = np.bincount(cells, minlength=grid.rows * grid.columns)
    return PointCells(grid, cells, np.argsort(cells, kind="stable"), np.concatenate([[0], np.cumsum(counts)]))
