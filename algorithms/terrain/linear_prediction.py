"""Linear prediction of heights (least squares interpolation with a covariance function), in overlapping units.

K. Kraus, N. Pfeifer, *Determination of terrain models in wooded areas with airborne laser scanner data*, ISPRS J. 53
(1998); N. Pfeifer, *Oberflächenmodelle aus Laserdaten*, VGI 4/2003, section 2.3.
"""

import math
from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Points, Scalars
from algorithms.deviations.rasters import Grid, GridValues
from algorithms.progress import Progress
from algorithms.terrain.neighbours import PointCells, sorted_into_cells
from algorithms.terrain.prediction_kernels import predict_unit

POINTS_OF_UNIT = 36
"""Wanted in the middle of a unit; with its margin of half an edge it has four times as many."""
MOST_POINTS = 600
"""In a unit with its margin: more are thinned evenly, for the work grows with their third power."""
LEAST_WEIGHT = 1e-3
"""Points of a smaller weight do not take part."""


@dataclass(frozen=True)
class Covariance:
    """How heights vary about a plane, and points about the terrain."""

    correlation_m: float
    """Distance at which the covariance has fallen to exp(-1/2) [m]."""
    relief_m: float
    """Standard deviation of the terrain about the plane of a unit [m]."""
    noise_m: float
    """Standard deviation of a point of weight 1 about the terrain [m]."""


@dataclass(frozen=True, eq=False)
class Predicted:
    """Heights at places."""

    heights_m: Scalars
    std_m: Scalars
    """Standard deviations of the terrain there, as covariance function and points tell; those of points add the noise
    [m]."""


def predicted(
    points: Points,
    weights: Scalars,
    places: Array,
    covariance: Covariance,
    progress: Progress,
    *,
    with_std: bool = False,
) -> Predicted:
    """Predict the heights of places from weighted points.

    The area is cut into square units; the points of a unit and of a margin of half its edge give the heights inside.

    Parameters
    ----------
    points
        (n, 3) [m].
    weights
        (n,) from 0 to 1: the variance of a point is noise² / weight.
    places
        (m, 2) or (m, 3) x and y [m].
    covariance
        Of the terrain.
    progress
        Of the units.
    with_std
        Compute standard deviations too, which takes longer; else they are NaN.
    """
    extent = np.maximum(np.ptp(points[:, :2], axis=0), 1e-3)
    edge = math.sqrt(float(extent.prod()) * POINTS_OF_UNIT / len(points))
    halves = sorted_into_cells(points, edge / 2.0)
    ours = _units_of_places(places, halves.grid)
    order = np.argsort(ours, kind="stable")
    borders = np.flatnonzero(np.diff(ours[order])) + 1
    heights, variances = np.empty(len(places)), np.empty(len(places))
    groups = np.split(order, borders)
    for turn, group in enumerate(groups):
        if turn % 256 == 0:
            progress.report(turn / len(groups), "linear prediction")
        unit_rows, unit_columns = divmod(int(ours[group[0]]), halves.grid.columns)
        numbers, (x, y) = _points_of_unit(halves, unit_rows, unit_columns)
        heights[group], variances[group] = predict_unit(
            points, weights, numbers, places[group], x, y,
            covariance.correlation_m, covariance.relief_m, covariance.noise_m, LEAST_WEIGHT,
            with_std,
        )  # fmt: skip
    return Predicted(heights, np.sqrt(variances))


def predicted_grid(
    points: Points,
    weights: Scalars,
    grid: Grid,
    covariance: Covariance,
    progress: Progress,
    *,
    with_std: bool = False,
) -> tuple[GridValues, GridValues]:
    """Predict the heights of the middles of all cells, and their standard deviations (NaN unless wanted) [m]."""
    found = predicted(points, weights, grid.centres(), covariance, progress, with_std=with_std)
    return found.heights_m.reshape(grid.shape), found.std_m.reshape(grid.shape)


def _units_of_places(places: Array, halves: Grid) -> Array:
    """Give the unit of each place: the upper left of its four half cells, as a number of the grid of halves."""
    column, row = np.floor((places[:, :2] - [halves.u_min_m, halves.v_min_m]) / halves.cell_m).astype(np.int64).T
    column = np.clip(column, 0, halves.columns - 1) // 2 * 2
    row = np.clip(row, 0, halves.rows - 1) // 2 * 2
    return np.asarray(row * halves.columns + column)


def _points_of_unit(halves: PointCells, row: int, column: int) -> tuple[Array, tuple[float, float]]:
    """Give the points of the unit of 2 x 2 half cells and one half cell around it, wider where there are few."""
    grid = halves.grid
    reach = 1
    while True:
        first, last = max(0, column - reach), min(grid.columns, column + 2 + reach)
        parts = [
            halves.order[halves.starts[r * grid.columns + first] : halves.starts[r * grid.columns + last]]
            for r in range(max(0, row - reach), min(grid.rows, row + 2 + reach))
        ]
        numbers = np.concatenate(parts)
        if len(numbers) >= POINTS_OF_UNIT or reach > max(grid.rows, grid.columns):
            break
        reach += 1
    if len(numbers) > MOST_POINTS:
        numbers = numbers[:: -(-len(numbers) // MOST_POINTS)]
    x = grid.u_min_m + (column + 1) * grid.cell_m
    y = grid.v_min_m + (row + 1) * grid.cell_m
    return numbers, (x, y)
