"""The points of a scan as a photo sees them: projected once, in cells, without what is hidden."""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Flags, Indices, Points, Scalars, Splits, Vectors2
from algorithms.features.photo_lines.photo_points_kernels import not_hidden, project, sort_into_cells
from algorithms.geometry.cameras import Camera

Corner: TypeAlias = Float64[Array, "2"]
"""A place in the photo [px]."""
NEAREST_M = 0.1
"""Points nearer to the focal plane have no useful image."""
POINTS_PER_CELL = 4.0
"""Aimed mean number of points in a cell: a surface leaves hardly any cell empty, and does not change much in depth."""
SMALLEST_CELL_PX, LARGEST_CELL_PX = 3.0, 100.0
STEEPEST = 8.0
"""Surfaces seen no flatter than with this tangent of incidence (83°) do not hide themselves."""
HIDDEN_BEHIND_M = 0.05
"""Points must lie so far behind others to be hidden: less than this moves no point by a pixel against another one,
as the camera sits close to the scanner."""


@dataclass(frozen=True, eq=False)
class PhotoPoints:
    """k points of a scan in a photo, sorted by cells of the photo."""

    numbers: Indices
    """(k,) their numbers in the scan."""
    points: Points
    """(k, 3) reduced scan frame [m]."""
    ideal: Vectors2
    """(k, 2) ideal pixels."""
    depths: Scalars
    """(k,) depths in the camera frame [m]."""
    visible: Flags
    """(k,) False where something in front of the point hides it from the camera."""
    starts: Splits
    """(rows * columns + 1,) first point of every cell, row by row."""
    rows: int
    columns: int
    low: Corner
    """(2,) upper left corner of the first cell [px]."""
    cell_px: float


def points_in_photo(
    points: Points, camera: Camera, scan_from_camera: RigidTransform, low: Corner, high: Corner
) -> PhotoPoints:
    """Project the points of a scan into a rectangle of ideal pixels.

    Parameters
    ----------
    points
        (n, 3) [m].
    camera, scan_from_camera
        Interior orientation, and pose in the frame of the points.
    low, high
        (2,) corners of the rectangle [px].
    """
    numbers, ideal, depths = project(
        points,
        np.ascontiguousarray(scan_from_camera.rotation.as_matrix().T),
        np.asarray(scan_from_camera.translation, dtype=np.float64),
        np.array([camera.fx, camera.fy]),
        np.array([camera.cx, camera.cy]),
        low,
        high,
        NEAREST_M,
    )
    width, height = high - low
    spacing = float(np.sqrt(width * height / max(len(numbers), 1)))
    cell = float(np.clip(np.sqrt(POINTS_PER_CELL) * spacing, SMALLEST_CELL_PX, LARGEST_CELL_PX))
    rows, columns = int(height / cell) + 1, int(width / cell) + 1
    order, starts = sort_into_cells(ideal, low, cell, rows, columns)
    depths = depths[order]
    steepest = STEEPEST * cell / min(camera.fx, camera.fy)
    return PhotoPoints(
        numbers=numbers[order],
        points=np.ascontiguousarray(points[numbers[order]]),
        ideal=np.ascontiguousarray(ideal[order]),
        depths=depths,
        visible=not_hidden(depths, starts, steepest, HIDDEN_BEHIND_M),
        starts=starts,
        rows=rows,
        columns=columns,
        low=low,
        cell_px=cell,
    )
