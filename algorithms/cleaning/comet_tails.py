"""Comet tails: points between a near edge and what lies behind it, singly or several in a row."""

import numpy as np

from algorithms.arrays import Array, Flags, GridIndex, Points, Vector3
from algorithms.cleaning import comet_tails_kernels as kernels
from algorithms.errors import InvalidInputError
from algorithms.scans.mixed_pixels import angular_step, grid_ranges, mixed_pixels
from algorithms.scans.point_blocks import over_blocks
from algorithms.scans.range_noise import range_noise
from algorithms.scans.scan import Scan

LIMIT_STD = 4.0
"""Beyond so many standard deviations of range a point is not the continuation of the surface beside it."""
ROUGHEST = 2.0
"""Pixels that lie off their common plane by more than so many times the noise are no surface: leaves, gravel."""
LEAST_NOISE_M = 0.001
"""No scan is taken for less noisy: its surfaces are not flatter [m]."""
LEAST_ROWS = 32
"""Fewer rows are not worth a thread's while."""
CLOSED_STEPS = 3.0
"""A raster whose first and last columns are nearer than so many steps goes round."""
LEAST_COLUMNS = 4
"""Narrower rasters do not go round."""

_SIDE = np.array([(a, b) for a in (-1, 0, 1) for b in (-2, -1)])
_BEYOND = np.array([(a, b) for a in (-1, 0, 1) for b in (-3, -2)])
_CORNER = np.array([(-1, -1), (-1, -2), (-2, -1), (-2, -2), (-1, -3), (-3, -1)])
_UPPER = np.array([(a, b) for a in (-1, 0) for b in (-3, -2, -1)])
_LOWER = np.array([(a, b) for a in (0, 1) for b in (-3, -2, -1)])
BESIDE = 4
"""The first blocks touch the pixel along a whole side: only a surface there may go on in it."""


def comet_tails(scan: Scan) -> Flags:
    """Mark the points of a structured scan that hang between surfaces.

    A beam that meets an edge returns a mixture of the ranges of what it lit. Where a surface ends, the pixels beside it
    are examined: blocks of six pixels around are tested for lying on a plane to within the noise, and when there are
    such planes, but the ones that touch the pixel do not go on in it, it lies on no surface. Where nothing around is a
    plane (leaves, grass) nothing is said but of single torn pixels (`mixed_pixels`).

    Parameters
    ----------
    scan
        With its raster and the place of the instrument.

    Returns
    -------
    (n,) True for points to leave out.

    Raises
    ------
    InvalidInputError
        The scan has no raster, or it is not known where the instrument stood.
    """
    if scan.grid is None or scan.sensor_m is None:
        missing = "rows and columns" if scan.grid is None else "the place of the instrument"
        raise InvalidInputError(f"scan {scan.name}".rstrip(), f"comet tails cannot be told without {missing}")
    points, sensor, index = np.ascontiguousarray(scan.points), np.asarray(scan.sensor_m), scan.grid.index
    ranges = grid_ranges(points, scan.grid, sensor)
    step = angular_step(points, scan.grid, sensor)
    noise = max(LEAST_NOISE_M, range_noise(ranges))
    marked = mixed_pixels(points, scan.grid, sensor, step, ranges)
    hanging = np.empty(index.shape, dtype=np.bool_)
    blocks, closed = _blocks(), _goes_round(points, index, sensor, step)

    def work(start: int, end: int) -> None:
        kernels.hanging_pixels(
            points, index, ranges, sensor, blocks, noise, LIMIT_STD, ROUGHEST, BESIDE, closed, start, end, hanging
        )

    over_blocks(work, len(index), least=LEAST_ROWS)
    marked |= hanging
    out = np.zeros(len(points), dtype=np.bool_)
    numbers = index[marked]
    out[numbers[numbers >= 0]] = True
    return out


def _blocks() -> Array:
    """Give the blocks (20, 6, 2) as offsets of rows and columns: four turns of each, those beside the pixel first."""
    return np.ascontiguousarray(
        [turned for block in (_SIDE, _BEYOND, _CORNER, _UPPER, _LOWER) for turned in _four_turns(block)], dtype=np.int64
    )


def _four_turns(block: Array) -> list[Array]:
    turns = [block]
    for _ in range(3):
        turns.append(np.column_stack([turns[-1][:, 1], -turns[-1][:, 0]]))
    return turns


def _goes_round(points: Points, index: GridIndex, sensor_m: Vector3, step_rad: float) -> bool:
    """Tell whether the last column of the raster lies beside the first one."""
    both = np.flatnonzero((index[:, 0] >= 0) & (index[:, -1] >= 0))
    if len(both) == 0 or index.shape[1] < LEAST_COLUMNS:
        return False
    first, last = (points[index[both, column]] - sensor_m for column in (0, -1))
    across = np.linalg.norm(np.cross(first, last), axis=1)
    return bool(np.median(np.arctan2(across, np.einsum("ij,ij->i", first, last))) < CLOSED_STEPS * step_rad)
