"""Capture the points of a plane from a seed on it, as people do where automatic detection joins what is apart."""

import numpy as np
from scipy.ndimage import binary_erosion, label
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Indices, OtherPoints, Points, Vector3
from algorithms.errors import InvalidInputError
from algorithms.geometry.lines import bases_of

SEED_POINTS = 30
ROUNDS = 10
CELL_SPACINGS = 3.0
"""Width of the raster's cells on which points hang together, in spacings of the points about the seed."""


def captured(points: OtherPoints, seed_m: Vector3, tolerance_m: float, reach_m: float) -> Indices:
    """Give the points of the plane at a seed: those within the tolerance that hang together with it.

    The rim, one cell of the raster wide, is left out: there lie points of the faces beside it.

    Parameters
    ----------
    points
        (n, 3) [m].
    seed_m
        A place on the plane [m].
    tolerance_m
        Largest distance from the plane, about three standard deviations of the points [m].
    reach_m
        Largest distance from the seed [m].

    Raises
    ------
    InvalidInputError
        There are too few points at the seed, or they lie in no plane.
    """
    near = np.array(sorted(cKDTree(points).query_ball_point(seed_m, reach_m)), dtype=np.int64)
    if len(near) < SEED_POINTS:
        raise InvalidInputError("seed_m", f"{len(near)} points lie within {reach_m:g} m of it", "move it, or reach on")
    own = points[near]
    distances, first = cKDTree(own).query(seed_m, k=SEED_POINTS)
    # thirty points spread evenly lie in a circle of this radius
    cell = CELL_SPACINGS * float(np.max(distances)) * np.sqrt(np.pi / SEED_POINTS)
    chosen = np.asarray(first)
    taken = chosen
    for _ in range(ROUNDS):
        centre, normal = _plane(own[chosen])
        flat = np.flatnonzero(np.abs((own - centre) @ normal) <= tolerance_m)
        cells = _cells(own[flat], seed_m, normal, cell)
        grown = flat[_hanging_together(cells, rim=False)]
        taken = flat[_hanging_together(cells, rim=True)]
        if len(grown) < SEED_POINTS:
            raise InvalidInputError("seed_m", f"the points at it lie in no plane to {tolerance_m:g} m")
        if np.array_equal(grown, chosen):
            break
        chosen = grown
    if len(taken) < SEED_POINTS:
        raise InvalidInputError("seed_m", f"the plane at it has {len(taken)} points without its rim", "more are needed")
    return near[np.sort(taken)]


def _plane(points: Points) -> tuple[Vector3, Vector3]:
    centre = points.mean(axis=0)
    _, vectors = np.linalg.eigh((points - centre).T @ (points - centre))
    return centre, vectors[:, 0]


def _cells(points: Array, seed_m: Vector3, normal: Vector3, cell_m: float) -> Array:
    """Give the cell of each point in the plane, (n, 2), the seed's cell being 0, 0."""
    return np.asarray(np.rint((points - seed_m) @ bases_of(normal[None])[0] / cell_m).astype(np.int64))


def _hanging_together(cells: Array, *, rim: bool) -> Array:
    """Tell which cells hang together with that of the seed; with `rim` without those at the border of all."""
    low = np.minimum(cells.min(axis=0), 0) - 1
    high = np.maximum(cells.max(axis=0), 0) + 2
    filled = np.zeros(high - low, dtype=np.bool_)
    places = cells - low
    filled[places[:, 0], places[:, 1]] = True
    parts, _ = label(filled, structure=np.ones((3, 3)))
    part = parts[-low[0], -low[1]]
    if part == 0:  # a hole at the seed itself: the largest part stands for it
        part = int(np.argmax(np.bincount(parts.ravel())[1:])) + 1
    own = parts == part
    if rim:
        own = binary_erosion(own, structure=np.ones((3, 3), dtype=np.bool_))
    return np.asarray(own[places[:, 0], places[:, 1]])
