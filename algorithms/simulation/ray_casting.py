"""First hits of rays with a scene."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from algorithms.arrays import Array, Flags, Indices, Points, Scalars, Vector3
from algorithms.scans.open3d_loading import import_open3d
from algorithms.simulation.scene import Scene

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
        open3d = import_open3d()
        self._core: Any = open3d.core
        self._which = np.arange(len(scene.triangles), dtype=np.int64) if which is None else which
        self._scene = scene
        self._centre = 0.5 * (scene.vertices.min(axis=0) + scene.vertices.max(axis=0))
        vertices = (scene.vertices - self._centre).astype(np.float32)
        triangles = scene.triangles[self._which].astype(np.uint32)
        self._tree: Any = open3d.t.geometry.RaycastingScene()
        self._tree.add_triangles(self._core.Tensor(vertices), self._core.Tensor(triangles))

    def cast(self, origins: Points | Vector3, directions: Points) -> Hits:
        """Find the first hits.

        Parameters
        ----------
        origins
            (n, 3), or (3,) common to all rays, in the scene's frame [m].
        directions
            (n, 3) unit vectors in the scene's frame.
        """
        rays = np.empty((len(directions), 6), dtype=np.float32)
        rays[:, :3] = origins - self._centre
        rays[:, 3:] = directions
        local = self._tree.cast_rays(self._core.Tensor(rays))["primitive_ids"].numpy()
        found = np.flatnonzero(local != np.iinfo(np.uint32).max)
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
        rays = np.empty((len(origins), 6), dtype=np.float32)
        rays[:, :3] = origins - self._centre
        rays[:, 3:] = directions
        met = self._tree.test_occlusions(self._core.Tensor(rays), tnear=nearest_m, tfar=farthest_m)
        return np.asarray(met.numpy(), dtype=bool)


def _hits(count: int, found: Array, triangles: Indices, ranges: Scalars, cosines: Scalars) -> Hits:
    """Spread the found hits over all rays."""
    all_ranges, all_cosines = np.full(count, np.inf), np.zeros(count)
    all_triangles = np.full(count, -1, dtype=np.int64)
    all_ranges[found], all_cosines[found], all_triangles[found] = ranges, cosines, triangles
    return Hits(all_ranges, all_triangles, all_cosines)
