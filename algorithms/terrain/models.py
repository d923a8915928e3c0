"""Models of heights: of the terrain, of what is seen from above, and of the difference.

N. Pfeifer, *Oberflächenmodelle aus Laserdaten*, VGI 4/2003, sections 1 and 3; the quality of models after M. Attwenger
and C. Briese, *Vergleich digitaler Geländemodelle aus Photogrammetrie und Laserscanning*, ibid.
"""

from dataclasses import dataclass, replace

import numpy as np

from algorithms.arrays import Flags, Points, Scalars
from algorithms.deviations.rasters import Grid, GridValues, raster_surface
from algorithms.progress import Progress
from algorithms.terrain.cell_heights import (
    GridFlags,
    cells_over,
    filled,
    heights_on,
    highest_heights,
    lowest_points,
    spacing_of,
    wide_gaps,
)
from algorithms.terrain.ground import ground_of
from algorithms.terrain.linear_prediction import Covariance, predicted_grid
from algorithms.terrain.options import Majority, Opening, TerrainFilter, Tin

GAP_M = 6.0
"""Gaps in a canopy, up to twice so wide, are closed; clearings and open land beside a wood stay what they are."""


SPACINGS = 5.0
"""Mean spacings of points across a gap: chance leaves so wide a disc among even points empty once in 10⁸ places."""


@dataclass(frozen=True)
class BridgedGaps:
    """How wide gaps may be over which models go on."""

    empty_m: float = 20.0
    """Widest gap without points, such as a lake [m]."""
    covered_m: float = 50.0
    """Widest area without ground points under objects [m]."""


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
    no_terrain: GridFlags
    """Cells in gaps of the ground points that are wider than `bridged`: the terrain there is no measurement."""
    no_surface: GridFlags
    """Cells in gaps of all points that are wider."""
    bridged: BridgedGaps
    """Widths up to which gaps are bridged: as stated, or wider where points are sparse."""

    @property
    def known_dtm_m(self) -> GridValues:
        """The terrain; NaN in wide gaps."""
        return np.where(self.no_terrain, np.nan, self.dtm_m)

    @property
    def known_dsm_m(self) -> GridValues:
        """What is seen from above; NaN in wide gaps."""
        return np.where(self.no_surface, np.nan, self.dsm_m)

    @property
    def known_ndsm_m(self) -> GridValues:
        """Heights of objects; NaN in wide gaps of either model."""
        return np.where(self.no_terrain | self.no_surface, np.nan, self.ndsm_m)

    @property
    def ndsm_m(self) -> GridValues:
        """Heights of objects: nDSM = DSM - DTM (the text of the source has the sign wrong)."""
        return np.asarray(self.dsm_m - self.dtm_m)


def terrain_models(
    points: Points,
    ground: Flags,
    cell_m: float,
    covariance: Covariance | None,
    progress: Progress,
    gaps: BridgedGaps | None = None,
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
    gaps
        How wide gaps may be that are bridged; None: as usual.

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
    gaps = gaps or BridgedGaps()
    bridged = BridgedGaps(_bridged_m(points, gaps.empty_m), _bridged_m(on_ground, gaps.covered_m))
    empty = wide_gaps(_seen(points, grid), cell_m, bridged.empty_m)
    covered = wide_gaps(_seen(on_ground, grid), cell_m, bridged.covered_m)
    surface_m = filled(highest_heights(points, grid))
    return TerrainModels(grid, dtm, np.where(empty | covered, np.nan, std), surface_m, empty | covered, empty, bridged)


def _bridged_m(points: Points, stated_m: float) -> float:
    """Return the widest gap that is bridged, wider than stated where the points leave such gaps by chance [m]."""
    return max(stated_m, SPACINGS * spacing_of(points)) if len(points) else stated_m


def _seen(points: Points, grid: Grid) -> GridFlags:
    """Return the cells (rows, columns) that hold points."""
    return np.asarray(np.bincount(grid.cells_of(points), minlength=grid.rows * grid.columns).reshape(grid.shape) > 0)


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


def gaps_in_words(models: TerrainModels) -> list[str]:
    """Describe where models have no data."""
    if not models.no_terrain.any():
        return []
    empty_m, covered_m = models.bridged.empty_m, models.bridged.covered_m
    share = f"{models.no_terrain.mean():.1%} of the cells have no terrain (no data)"
    where = f"in gaps wider than {empty_m:.3g} m without points, or than {covered_m:.3g} m without ground points"
    return [f"{share}: they lie {where}"]
