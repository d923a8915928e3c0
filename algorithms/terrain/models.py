"""Models of heights: of the terrain, of what is seen from above, and of the difference.

N. Pfeifer, *Oberflächenmodelle aus Laserdaten*, VGI 4/2003, sections 1 and 3; the quality of models after M. Attwenger
and C. Briese, *Vergleich digitaler Geländemodelle aus Photogrammetrie und Laserscanning*, ibid.
"""

from dataclasses import dataclass, replace

import numpy as np

from algorithms.arrays import Flags, Points, Scalars
from algorithms.deviations.rasters import Grid, GridValues, raster_surface
from algorithms.progress import Progress
from algorithms.terrain.cell_heights import cells_over, filled, heights_on, highest_heights, lowest_points
from algorithms.terrain.ground import ground_of
from algorithms.terrain.linear_prediction import Covariance, predicted_grid
from algorithms.terrain.options import Majority, Opening, TerrainFilter, Tin

GAP_M = 6.0
"""Gaps in a canopy, up to twice so wide, are closed; clearings and open land beside a wood stay what they are."""


@dataclass(frozen=True, eq=False)
class TerrainModels:
    """Heights on the cells of one grid [m]."""

    grid: Grid
    dtm_m: GridValues
    """The terrain (DTM), without gaps."""
    dtm_std_m: GridValues
    """Expected standard deviation of its heights, from density, distance, curvature and residuals of the ground points;
    NaN where too few are near."""
    dsm_m: GridValues
    """What is seen from above (DSM): the highest point of each cell, gaps filled from those around."""

    @property
    def ndsm_m(self) -> GridValues:
        """Heights of objects: nDSM = DSM - DTM (the text of the source has the sign wrong)."""
        return np.asarray(self.dsm_m - self.dtm_m)


def terrain_models(
    points: Points, ground: Flags, cell_m: float, covariance: Covariance | None, progress: Progress
) -> TerrainModels:
    """Make the models of heights of classified points.

    Parameters
    ----------
    points
        (n, 3) [m].
    ground
        (n,) True on the ground.
    cell_m
        Edge of the cells [m].
    covariance
        Of linear prediction through the lowest ground points of the cells; None: a moving plane through all ground
        points of a cell and its neighbours, gaps filled by a membrane.
    progress
        Of the prediction.

    Raises
    ------
    InvalidInputError
        The grid has too many cells, or there is no ground.
    """
    grid = cells_over(points, cell_m)
    on_ground = points[ground]
    if covariance is None:
        surface = raster_surface(on_ground, grid)
        known = np.isfinite(surface.heights_m)
        heights = surface.heights_m if known.any() else _lowest(on_ground, grid)
        dtm, std = filled(heights), surface.std_m
    else:
        data = on_ground[lowest_points(on_ground, grid)]
        dtm, std = predicted_grid(data, np.ones(len(data)), grid, covariance, progress, with_std=True)
    return TerrainModels(grid, dtm, std, filled(highest_heights(points, grid)))


def _lowest(points: Points, grid: Grid) -> GridValues:
    return -highest_heights(points * [1.0, 1.0, -1.0], grid)


@dataclass(frozen=True, eq=False)
class Canopy:
    """The upper surface of plants, on the cells of the terrain [m]."""

    heights_m: GridValues
    """Of the canopy, without gaps; on open ground it is the terrain's."""
    stand_m: GridValues
    """Above the terrain."""


def canopy_over(
    points: Points, models: TerrainModels, chosen: TerrainFilter, cell_m: float, progress: Progress
) -> Canopy:
    """Give the canopy by a filter turned upside down: what it calls ground then is seen from above.

    Points inside the crowns and on the floor of a forest are left out as those on objects are of the terrain; the
    difference from the terrain is the height of the stand. Windows of a filter are at most `GAP_M`.

    Parameters
    ----------
    points
        (n, 3) [m].
    models
        Of the same points.
    chosen
        The filter.
    cell_m
        Edge of the cells [m].
    progress
        Of the filter.
    """
    upside_down = points * np.array([1.0, 1.0, -1.0])
    if isinstance(chosen, Opening | Tin | Majority):
        # seen from above it is not buildings that stand in the way: with their windows a clearing would be an object
        chosen = replace(chosen, window_m=min(chosen.window_m, GAP_M))
    top = ground_of(upside_down, chosen, cell_m, progress).ground
    heights = filled(highest_heights(points[top], models.grid))
    return Canopy(heights, heights - models.dtm_m)


def residuals_above(points: Points, models: TerrainModels) -> Scalars:
    """Give the heights of points above the terrain, (n,) [m]."""
    return np.asarray(points[:, 2] - heights_on(models.dtm_m, models.grid, points))
