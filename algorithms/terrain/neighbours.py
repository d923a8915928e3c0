"""Points sorted into square cells, so that neighbours in plan are found at once."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Indices, Points
from algorithms.deviations.rasters import Grid
from algorithms.terrain.cell_heights import cells_over


@dataclass(frozen=True, eq=False)
class PointCells:
    """Points cell after cell, so that neighbours are near each other in memory too."""

    grid: Grid
    points: Points
    """(n, 3) [m]."""
    cells: Indices
    """(n,) cell of each, ascending."""
    order: Array
    """(n,) number that each had before."""
    starts: Array
    """(cells + 1,) where each cell begins."""

    @property
    def lowest(self) -> Array:
        """Give the least height of each cell [m]; infinity where there is none."""
        out = np.full(len(self.starts) - 1, np.inf)
        filled = np.flatnonzero(np.diff(self.starts) > 0)
        out[filled] = np.minimum.reduceat(self.points[:, 2], self.starts[filled])
        return out

    def as_before(self, values: Array) -> Array:
        """Put what is said of each point (n, …) into the order that they had before."""
        out = np.empty_like(values)
        out[self.order] = values
        return out


def sorted_into_cells(points: Points, edge_m: float) -> PointCells:
    """Sort points into square cells; O(n log n)."""
    grid = cells_over(points, edge_m)
    cells = grid.cells_of(points)
    counts = np.bincount(cells, minlength=grid.rows * grid.columns)
    order = np.argsort(cells, kind="stable")
    return PointCells(grid, points[order], cells[order], order, np.concatenate([[0], np.cumsum(counts)]))
