"""First hits of rays with a scene."""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Flags, Indices, Points, Scalars, Vector3
from algorithms.simulation.scene import Scene
from algorithms.simulation.triangle_rays import NOTHING_MET, triangle_rays

MIN_COSINE = 1e-4
"""Rays flatter than this against a face do not come back."""


@dataclass(frozen=True, eq=False)
class Hits:
    """What n rays met first."""

    ranges_m: Scalars
    """(n,) distance along the unit ray, inf where nothing was met [m]."""
    triangles: Indices
    """(n,) triangle of the scene, -1 where nothing was met."""
    cosines: Scalars
    """(n,) cosine of the incidence angle, 0 where nothing was met."""

    @property
    def found(self) -> Flags:
        """(n,) True where something was met."""
        return np.asarray(self.triangles >= 0)


class RayCaster:
    """Cast rays at (part of) a scene.

    Embree finds the triangle in single precision; the range is then computed anew in double precision from the
    triangle's plane, so that it is exact to 1e-12 of the scene's size. Only which of two neighbouring triangles is hit
    within a micrometre of their common edge is left to single precision.
    """

    def __init__(self, scene: Scene, which: Indices | None = None) -> None:
        """Prepare the search tree; `which` selects triangles, by default all."""
        self._which = np.arange(len(scene.triangles), dtype=np.int64) if which is None else which
        self._scene = scene
        self._centre = 0.5 * (scene.vertices.min(axis=0) + scene.vertices.max(axis=0))
        self._tree = triangle_rays(scene.vertices - self._centre, scene.triangles[self._which])

    def cast(self, origins: Points | Vector3, directions: Points) -> Hits:
        """Find the first hits.

        Parameters
        ----------
        origins
            (n, 3), or (3,) common to all rays, in the scene's frame [m].
        directions
            (n, 3) unit vectors in the scene's frame.
        """
        local = self._tree.first_met(*self._rays(origins, directions))
        found = np.flatnonzero(local != NOTHING_MET)
        triangles = self._which[local[found]]
        origin = np.broadcast_to(origins, directions.shape)[found]
        normals = self._scene.normals[triangles]
        towards = np.einsum("ij,ij->i", normals, directions[found])
        height = self._scene.offsets_m[triangles] - np.einsum("ij,ij->i", normals, origin)
        steep = np.abs(towards) > MIN_COSINE
        found, triangles = found[steep], triangles[steep]
        return _hits(len(directions), found, triangles, height[steep] / towards[steep], np.abs(towards[steep]))

    def occluded(
        self, origins: Points, directions: Points | Vector3, nearest_m: float, farthest_m: float = np.inf
    ) -> Flags:
        """Tell from which origins (n, 3) rays along unit directions, (n, 3) or one for all, meet anything.

        What is nearer than `nearest_m` or farther than `farthest_m` does not count.
        """
        return self._tree.any_met(*self._rays(origins, directions), nearest_m, farthest_m)

    def _rays(self, origins: Array, directions: Array) -> tuple[Array, Array]:
        """Return origins and directions (n, 3) about the middle of the scene, in single precision."""
        starts, ways = np.broadcast_arrays(origins - self._centre, directions)
        return np.ascontiguousarray(starts, dtype=np.float32), np.ascontiguousarray(ways, dtype=np.float32)


def _hits(count: int, found: Array, triangles: Indices, ranges: Scalars, cosines: Scalars) -> Hits:
    """Spread the found hits over all rays."""
    all_ranges, all_cosines = np.full(count, np.inf), np.zeros(count)
    all_triangles = np.full(count, -1, dtype=np.int64)
    all_ranges[found], all_cosines[found], all_triangles[found] = ranges, cosines, triangles
    return Hits(all_ranges, all_triangles, all_cosines)
