"""Cells of space that know which part of a surface is nearest (the d2-tree of Hofer and Pottmann 2004).

Each cell has the place of the surface that is nearest to its middle, and with it the quadratic approximant of the
squared distance: points are paired by looking up their cell, and nothing is searched that was found before. Cells are
small near the surface and larger the farther they are from it, where the approximant changes slowly.
"""

import numpy as np

from algorithms.arrays import Array, Points
from algorithms.closest_points.surface_model import SurfaceModel

FAR_CELLS = 4.0
"""Cells whose middle is so many times their edge away from the surface are not divided any more."""
HALF_DIAGONAL = 0.5 * float(np.sqrt(3.0))
BITS = 20
"""Of the number of a cell along each axis."""


class _Level:
    """Cells of one size that were needed so far, in the order of their keys."""

    def __init__(self, edge_m: float) -> None:
        self.edge_m = edge_m
        self.keys = np.empty(0, dtype=np.int64)
        self.feet = np.empty(0, dtype=np.int64)
        self.distances_m = np.empty(0)


class D2Tree:
    """Find the nearest surface of points through cells, which are filled where points come by.

    Parameters
    ----------
    surface
        Of the target.
    finest_m
        Edge of the smallest cells [m].
    reach_m
        As far from the surface points are paired [m].
    """

    def __init__(self, surface: SurfaceModel, finest_m: float, reach_m: float) -> None:
        self._surface = surface
        self._low = surface.points.min(axis=0) - 2.0 * reach_m
        edges = [finest_m]
        while edges[-1] * FAR_CELLS < reach_m:
            edges.append(2.0 * edges[-1])
        self._levels = [_Level(edge) for edge in edges]

    def nearest(self, points: Points, max_distance_m: float) -> tuple[Array, Array]:
        """Pair points with surface: numbers of the points that have any near, and of the surface's points.

        Parameters
        ----------
        points
            (m, 3) [m].
        max_distance_m
            Farther ones have none [m].
        """
        feet = np.full(len(points), -1, dtype=np.int64)
        left = np.flatnonzero(
            ((points > self._low) & (points - self._low < self._levels[0].edge_m * 2**BITS)).all(axis=1)
        )
        for level in reversed(self._levels):
            found, distances = self._cells_of(level, points[left])
            reachable = distances - HALF_DIAGONAL * level.edge_m <= max_distance_m
            is_leaf = (
                (distances >= FAR_CELLS * level.edge_m) if level is not self._levels[0] else np.ones(len(left), bool)
            )
            done = is_leaf & reachable
            feet[left[done]] = found[done]
            left = left[~is_leaf & reachable]
        own = np.flatnonzero(feet >= 0)
        gaps = np.linalg.norm(points[own] - self._surface.points[feet[own]], axis=1)
        own = own[gaps <= max_distance_m]
        return own, feet[own]

    @property
    def cell_count(self) -> int:
        """Count the cells that were filled so far."""
        return sum(len(level.keys) for level in self._levels)

    def _cells_of(self, level: _Level, points: Points) -> tuple[Array, Array]:
        """Give foot and distance of the middles of the cells that points lie in; fill those that are new."""
        places = np.floor((points - self._low) / level.edge_m).astype(np.int64)
        keys = (places[:, 0] << 2 * BITS) | (places[:, 1] << BITS) | places[:, 2]
        new, firsts = np.unique(keys, return_index=True)
        at = np.searchsorted(level.keys, new)
        known = (at < len(level.keys)) & (np.append(level.keys, -1)[np.minimum(at, len(level.keys))] == new)
        if not known.all():
            middles = self._low + (places[firsts[~known]] + 0.5) * level.edge_m
            distances, feet = self._surface.tree.query(middles)
            level.keys = np.insert(level.keys, at[~known], new[~known])
            level.feet = np.insert(level.feet, at[~known], np.asarray(feet, dtype=np.int64))
            level.distances_m = np.insert(level.distances_m, at[~known], distances)
        at = np.searchsorted(level.keys, keys)
        return level.feet[at], level.distances_m[at]
