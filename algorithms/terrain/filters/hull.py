"""The lower convex hull, densified (Hansen and Vögtle 1999)."""

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from algorithms.arrays import Array, Flags, Points
from algorithms.errors import InvalidInputError
from algorithms.progress import Progress
from algorithms.terrain.bands import within_band
from algorithms.terrain.cell_heights import cells_over, lowest_points
from algorithms.terrain.densification import densified, heights_of_net, near_or_below
from algorithms.terrain.options import Hull
from algorithms.terrain.triangulation import corners_around


def hull(points: Points, options: Hull, cell_m: float, progress: Progress) -> Flags:
    """Tell which points (n,) lie on the ground.

    No point of the lower half of the convex hull, whose outward normals point down, is above the ground. Points are
    added to its triangles as to those of `tin`.

    Parameters
    ----------
    points
        (n, 3) without points below the ground [m].
    options
        Thresholds.
    cell_m
        Edge of the cells whose lowest points take part [m].
    progress
        Of the rounds.
    """
    grid = cells_over(points, cell_m)
    candidates = points[lowest_points(points, grid)]
    lower = _lower_hull(candidates)
    vertices = np.vstack([corners_around(points, lower), lower])
    accepts = near_or_below(options.distance_m, float(np.radians(options.angle_deg)))
    terrain = heights_of_net(densified(vertices, candidates, accepts, progress), grid)
    return within_band(points, terrain, grid, options.tolerance_m, options.per_slope_m)


def _lower_hull(points: Points) -> Array:
    try:
        found = ConvexHull(points)
    except QhullError:
        raise InvalidInputError("terrain", "all points lie in one plane", "use another filter") from None
    down = found.equations[:, 2] < 0.0
    return np.asarray(points[np.unique(found.simplices[down])])
