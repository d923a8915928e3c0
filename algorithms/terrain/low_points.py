"""Points far below all others: multipath and other errors of the range, which no ground lies on."""

import math

import numpy as np

from algorithms.arrays import Flags, Points
from algorithms.terrain.cell_heights import spacing_of
from algorithms.terrain.neighbours import sorted_into_cells
from algorithms.terrain.neighbours_kernels import few_as_low

RADIUS = 8.0
"""Of the neighbourhood, in mean spacings."""
LEAST_SHARE = 0.03
"""Of the points that open ground would have there: under the densest trees some points in a hundred reach it."""


def low_points(points: Points) -> Flags:
    """Tell which points (n,) have hardly any others as low around them.

    Where a point lies on the ground, others do too, be it in a courtyard or below trees; below it there are some points
    at most. Points of which fewer than `LEAST_SHARE` of a full neighbourhood lie below a cone that opens upwards from
    1 m above them by half of the distance are low. What stands alone on high, as the last roof at a border, is not
    concerned, for lower ground is near.

    Parameters
    ----------
    points
        (n, 3) [m].
    """
    spacing = spacing_of(points)
    sorted_ = sorted_into_cells(points, 2.0 * spacing)
    needed = max(2, round(LEAST_SHARE * math.pi * RADIUS**2))
    few = few_as_low(
        sorted_.points, sorted_.cells, sorted_.starts, sorted_.grid.columns, 2.0 * spacing, RADIUS * spacing, needed
    )
    return np.asarray(sorted_.as_before(few))
