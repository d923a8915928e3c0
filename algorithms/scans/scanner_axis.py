"""Where up is: the axis about which a scanner turned, from the grid in which it recorded.

The coordinates of a file need not be upright; its grid tells nevertheless. The rays of one column lie in a plane
through the axis, so the axis is at right angles to the normals of these planes. Scanners look farther up than down, as
their own foot is in the way below.
"""

import numpy as np

from algorithms.arrays import Array, Vector3
from algorithms.scans.scan import Scan

COLUMNS = 400
"""Of so many columns the planes are taken."""
LEAST_SINE = 0.1
"""Sine of the least angle between the first and the last ray of a column."""
LEAST_SPREAD, MOST_MISFIT = 0.02, 1e-3
"""Normals of the columns' planes determine an axis when the two others of their principal axes are so much alike, and
that along the axis is so small."""
LEAST_LEAD_RAD = float(np.deg2rad(5.0))
"""The field of view tells up from down where it reaches so much farther to one side."""


def scanner_axis(scan: Scan) -> Vector3:
    """Give the unit direction (3,) upwards along the scanner's axis, in the axes of the scan's points.

    Where there is no grid, the instrument's position is not known, or the grid determines no axis, it is the z axis.
    """
    upright = np.array([0.0, 0.0, 1.0])
    if scan.grid is None or scan.sensor_m is None or len(scan) == 0:
        return upright
    index = scan.grid.index
    columns = np.unique(np.linspace(0, scan.grid.columns - 1, COLUMNS).astype(np.int64))
    seen = index[:, columns] >= 0
    columns, seen = columns[seen.any(axis=0)], seen[:, seen.any(axis=0)]
    first, last = np.argmax(seen, axis=0), scan.grid.rows - 1 - np.argmax(seen[::-1], axis=0)
    starts, ends = (_rays(scan, index[rows, columns]) for rows in (first, last))
    normals: Array = np.cross(starts, ends)
    normals = normals[np.linalg.norm(normals, axis=1) > LEAST_SINE]
    if len(normals) == 0:
        return upright
    values, vectors = np.linalg.eigh(normals.T @ normals)
    if values[1] < LEAST_SPREAD * values[2] or values[0] > MOST_MISFIT * values[1]:
        return upright
    axis = vectors[:, 0]
    rows, elevations = (
        np.concatenate([first, last]),
        np.arcsin(np.clip(np.concatenate([starts, ends]) @ axis, -1.0, 1.0)),
    )
    slope, start = np.polyfit(rows, elevations, 1)
    lead = float(2.0 * start + slope * (scan.grid.rows - 1))
    downwards = lead < 0.0 if abs(lead) > LEAST_LEAD_RAD else float(axis @ upright) < 0.0
    return np.asarray(-axis if downwards else axis)


def _rays(scan: Scan, numbers: Array) -> Array:
    """Give the unit rays (n, 3) from the instrument to points."""
    rays = scan.points[numbers] - scan.sensor_m
    return np.asarray(rays / np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-9))
