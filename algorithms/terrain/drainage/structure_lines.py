"""Valleys, and ridges as the valleys of the terrain turned upside down."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Points
from algorithms.deviations.rasters import Grid, GridValues
from algorithms.terrain.drainage.rain import Rain, rain_on


@dataclass(frozen=True, eq=False)
class StructureLine:
    """Where much water runs, downstream."""

    points: Points
    """(k, 3) middles of cells, with the heights of the terrain [m]."""
    length_m: float
    """In plan [m]."""
    catchment_m2: float
    """From which water runs to its end [m²]."""


def valleys(
    heights_m: GridValues, rain: Rain, grid: Grid, least_catchment_m2: float, least_length_m: float
) -> list[StructureLine]:
    """Give the lines along which water from a large area runs, from springs and junctions to junctions and outlets.

    Parameters
    ----------
    heights_m
        The terrain [m].
    rain
        On it.
    grid
        Its cells.
    least_catchment_m2
        Area from which a line begins [m²].
    least_length_m
        Shorter lines are left out [m].
    """
    catchment = (rain.runoff.ravel() + 1.0) * grid.cell_m**2
    wet = np.isfinite(catchment) & (catchment >= least_catchment_m2)
    main = np.where(wet, rain.main, -1)
    carried = wet & (main >= 0)
    inflows = np.bincount(main[carried], minlength=len(main))
    starts = np.flatnonzero(carried & (inflows != 1))
    centres, flat = grid.centres(), heights_m.ravel()
    lines = []
    for start in starts.tolist():
        cells = [start]
        while main[cells[-1]] >= 0:
            cells.append(int(main[cells[-1]]))
            if inflows[cells[-1]] != 1:
                break
        line = _line(cells, centres, flat, catchment)
        if line.length_m >= least_length_m:
            lines.append(line)
    return lines


def ridges(heights_m: GridValues, grid: Grid, least_catchment_m2: float, least_length_m: float) -> list[StructureLine]:
    """Give the valleys of the terrain with its heights turned upside down, with their true heights."""
    upside_down = -heights_m
    lines = valleys(upside_down, rain_on(upside_down), grid, least_catchment_m2, least_length_m)
    return [StructureLine(line.points * [1.0, 1.0, -1.0], line.length_m, line.catchment_m2) for line in lines]


def _line(cells: list[int], centres: Array, heights: Array, catchment: Array) -> StructureLine:
    points = np.column_stack([centres[cells], heights[cells]])
    length = float(np.hypot(*np.diff(points[:, :2], axis=0).T).sum())
    # the last cell may be a junction, which has the water of others too
    last = cells[-2] if len(cells) > 1 else cells[-1]
    return StructureLine(points, length, float(catchment[last]))
