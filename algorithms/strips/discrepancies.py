"""How far overlapping strips lie apart, cell by cell: the picture that every block needs (Kager 2003, 6)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Scalars
from algorithms.deviations.rasters import Grid, GridValues, grid_over, raster_surface

MOST_CELLS = 4_000_000
"""Of one strip's rectangle; more make the cells larger."""
SMOOTH_M = 0.05
"""Cells whose height has a larger standard deviation are rough: plants, walls [m]."""
STEEPEST = 1.5
"""Cells that rise by more from their neighbours, over their width, show walls."""


@dataclass(frozen=True, eq=False)
class Discrepancies:
    """Heights of strips less those of strips before them in the list, where both are smooth."""

    grid: Grid
    largest_m: GridValues
    """Of the differences in a cell that which is largest without its sign; NaN where strips do not overlap [m]."""
    differences_m: Scalars
    """(n,) all differences, one for each cell and pair of strips [m]."""

    def thinned(self, most: int) -> GridValues:
        """Give the largest of neighbouring cells, so many along a side at most."""
        step = -(-max(self.grid.shape) // most)
        if step == 1:
            return self.largest_m
        rows, columns = (-(-length // step) for length in self.grid.shape)
        padded = np.full((rows * step, columns * step), np.nan)
        padded[: self.grid.rows, : self.grid.columns] = self.largest_m
        blocks = padded.reshape(rows, step, columns, step).swapaxes(1, 2).reshape(rows, columns, step * step)
        which = np.nan_to_num(np.abs(blocks), nan=-1.0).argmax(axis=2)
        return np.take_along_axis(blocks, which[:, :, None], axis=2)[:, :, 0]


@dataclass(frozen=True)
class DiscrepancyFigures:
    """What differences are like."""

    cells: int
    rms_m: float | None
    median_m: float | None
    """Median without signs; None without cells."""
    quantile_95_m: float | None
    """95 % are smaller, without signs."""


def cell_for(strips: Sequence[Array], wished_m: float) -> float:
    """Give the edge of the cells [m]: as wished, or larger where rectangles about strips would have too many."""
    areas = [float(np.prod(points[:, :2].max(axis=0) - points[:, :2].min(axis=0))) for points in strips]
    return max(wished_m, float(np.sqrt(max(areas) / MOST_CELLS)))


def discrepancies(strips: Sequence[Array], cell_m: float) -> Discrepancies:
    """Compare the surfaces of strips (moving planes, MATH 11.5) wherever two overlap.

    Parameters
    ----------
    strips
        Of each strip points (n, 3), in the same frame, z upwards [m].
    cell_m
        Edge of the cells [m].
    """
    whole = grid_over(strips, cell_m, overlap=False)
    largest = np.full(whole.shape, np.nan)
    surfaces: list[tuple[GridValues, int, int]] = []
    differences: list[Array] = []
    for points in strips:
        grid = grid_over([points], cell_m, overlap=False)
        row, column = (
            round((a - b) / cell_m) for a, b in ((grid.v_min_m, whole.v_min_m), (grid.u_min_m, whole.u_min_m))
        )
        surface = raster_surface(points, grid)
        heights = np.where((surface.std_m <= SMOOTH_M) & _gentle(surface.heights_m, cell_m), surface.heights_m, np.nan)
        for other, r, c in surfaces:
            top, left = max(row, r), max(column, c)
            bottom = min(row + heights.shape[0], r + other.shape[0])
            right = min(column + heights.shape[1], c + other.shape[1])
            if top >= bottom or left >= right:
                continue
            own = heights[top - row : bottom - row, left - column : right - column]
            apart = own - other[top - r : bottom - r, left - c : right - c]
            known = np.isfinite(apart)
            differences.append(apart[known])
            painted = largest[top:bottom, left:right]
            larger = known & ~(np.abs(painted) >= np.abs(apart))
            painted[larger] = apart[larger]
        surfaces.append((heights, row, column))
    return Discrepancies(whole, largest, np.concatenate(differences) if differences else np.zeros(0))


def figures_of(differences_m: Scalars) -> DiscrepancyFigures:
    """Describe differences."""
    if len(differences_m) == 0:
        return DiscrepancyFigures(0, None, None, None)
    sizes = np.abs(differences_m)
    return DiscrepancyFigures(
        len(sizes), float(np.sqrt((sizes**2).mean())), float(np.median(sizes)), float(np.quantile(sizes, 0.95))
    )


def _gentle(heights: GridValues, cell_m: float) -> Array:
    """Tell where a cell does not rise steeply from any neighbour."""
    limit = STEEPEST * cell_m
    good = np.ones(heights.shape, dtype=np.bool_)
    for axis in (0, 1):
        steep = np.abs(np.diff(heights, axis=axis)) > limit
        first = (slice(None, -1), slice(None)) if axis == 0 else (slice(None), slice(None, -1))
        second = (slice(1, None), slice(None)) if axis == 0 else (slice(None), slice(1, None))
        good[first] &= ~steep
        good[second] &= ~steep
    return good
