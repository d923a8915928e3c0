"""Compiled loops of the search for the instrument's position."""

import math
from typing import Any

import numpy as np
from numba import njit

from algorithms.arrays import Array


@njit(cache=True, nogil=True)
def _cube_cell(x: float, y: float, z: float, cells: int) -> Any:  # pragma: no cover - compiled
    """Find the cell that a ray passes on a cube of 6 faces of cells x cells around the eye: cheaper than angles."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        face, u, v = (0 if x > 0.0 else 1), y / max(ax, 1e-12), z / max(ax, 1e-12)
    elif ay >= az:
        face, u, v = (2 if y > 0.0 else 3), x / ay, z / ay
    else:
        face, u, v = (4 if z > 0.0 else 5), x / az, y / az
    i = min(cells - 1, int((u + 1.0) * 0.5 * cells))
    j = min(cells - 1, int((v + 1.0) * 0.5 * cells))
    return (face * cells + i) * cells + j


@njit(cache=True, nogil=True)
def hidden_shares(
    points: Array,
    normals: Array,
    positions: Array,
    cells: int,
    spacing_m: float,
    start: int,
    end: int,
    shares: Array,
) -> Any:  # pragma: no cover - compiled
    """Write for positions from `start` to `end` the share of points behind another surface seen in the same direction.

    A point is hidden when the nearest point of its cell is clearly nearer and neither lies on the other's tangent
    plane: floors and walls seen at grazing incidence spread over a range within one cell without hiding themselves.
    """
    n = points.shape[0]
    nearest = np.empty(6 * cells * cells)
    owner = np.empty(6 * cells * cells, dtype=np.int64)
    cell = np.empty(n, dtype=np.int64)
    ranges = np.empty(n)
    for c in range(start, end):
        nearest[:] = np.inf
        for k in range(n):
            x = points[k, 0] - positions[c, 0]
            y = points[k, 1] - positions[c, 1]
            z = points[k, 2] - positions[c, 2]
            r = math.sqrt(x * x + y * y + z * z)
            q = _cube_cell(x, y, z, cells)
            cell[k] = q
            ranges[k] = r
            if r < nearest[q]:
                nearest[q] = r
                owner[q] = k
        hidden = 0
        for k in range(n):
            r = ranges[k]
            if r - nearest[cell[k]] < 3.0 * spacing_m + 0.03 * r:
                continue
            j = owner[cell[k]]
            dx = points[k, 0] - points[j, 0]
            dy = points[k, 1] - points[j, 1]
            dz = points[k, 2] - points[j, 2]
            own = abs(normals[k, 0] * dx + normals[k, 1] * dy + normals[k, 2] * dz)
            other = abs(normals[j, 0] * dx + normals[j, 1] * dy + normals[j, 2] * dz)
            own_known = normals[k, 0] != 0.0 or normals[k, 1] != 0.0 or normals[k, 2] != 0.0
            other_known = normals[j, 0] != 0.0 or normals[j, 1] != 0.0 or normals[j, 2] != 0.0
            if (own_known and own < 2.0 * spacing_m) or (other_known and other < 2.0 * spacing_m):
                continue
            hidden += 1
        shares[c] = hidden / n
