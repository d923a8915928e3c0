"""Contour lines of height grids."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import contourpy
import numpy as np

from algorithms.arrays import Points
from algorithms.deviations.rasters import Grid, GridValues
from algorithms.errors import InvalidInputError

MOST_LEVELS = 2000


@dataclass(frozen=True, eq=False)
class Contour:
    """The lines at one height."""

    height_m: float
    lines: Sequence[Points]
    """Each (k, 3), in the frame of the grid [m]; closed ones end where they begin."""


def contours(heights_m: GridValues, grid: Grid, interval_m: float, base_m: float = 0.0) -> list[Contour]:
    """Give the lines of equal height, at whole multiples of an interval.

    Parameters
    ----------
    heights_m, grid
        Heights [m], NaN where there is none, and their cells.
    interval_m
        Between lines [m].
    base_m
        What was subtracted from the heights [m].

    Raises
    ------
    InvalidInputError
        Too many lines.
    """
    low, high = float(np.nanmin(heights_m)) + base_m, float(np.nanmax(heights_m)) + base_m
    first, last = math.ceil(low / interval_m), math.floor(high / interval_m)
    if last - first + 1 > MOST_LEVELS:
        why = f"an interval of {interval_m:g} m makes {last - first + 1} heights"
        raise InvalidInputError("contour_interval_m", why, f"at most {MOST_LEVELS}: a larger interval")
    if min(grid.shape) < 2:
        return []
    x = grid.u_min_m + grid.cell_m * (np.arange(grid.columns) + 0.5)
    y = grid.v_min_m + grid.cell_m * (np.arange(grid.rows) + 0.5)
    generator = contourpy.contour_generator(x, y, np.ma.masked_invalid(heights_m))
    found = []
    for step in range(first, last + 1):
        height = step * interval_m
        plan = [np.asarray(line) for line in generator.lines(height - base_m)]
        lines = [np.column_stack([line, np.full(len(line), height - base_m)]) for line in plan if len(line) > 1]
        if lines:
            found.append(Contour(height, lines))
    return found
