"""Rays against triangles in single precision, by Embree."""

from importlib.util import find_spec
from typing import Any, TypeAlias

import numpy as np

from algorithms.arrays import Array, Flags
from algorithms.scans.open3d_loading import import_open3d

NOTHING_MET = -1


class ByEmbreex:
    """Rays by the package `embreex`; arrays as in `triangle_rays`."""

    def __init__(self, vertices: Array, triangles: Array) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._scene: Any = EmbreeScene(robust=True)
        self._mesh: Any = TriangleMesh(self._scene, vertices, np.ascontiguousarray(triangles, dtype=np.int32))

    def first_met(self, origins: Array, directions: Array) -> Array:
        """Return the number (n,) of the triangle that each ray meets first, -1 for none."""
        return np.asarray(self._scene.run(origins, directions, query="INTERSECT"), dtype=np.int64)

    def any_met(self, origins: Array, directions: Array, nearest: float, farthest: float) -> Flags:
        """Return whether each ray (n,) meets a triangle between two distances, in lengths of its direction."""
        # rays begin at their origin here, so that is where the nearest distance is put
        starts = np.ascontiguousarray(origins + np.float32(nearest) * directions)
        reach = float(np.minimum(farthest - nearest, np.finfo(np.float32).max))
        return np.asarray(self._scene.run(starts, directions, reach, query="OCCLUDED") != NOTHING_MET)


class ByOpen3d:
    """Rays by open3d, likewise."""

    def __init__(self, vertices: Array, triangles: Array) -> None:
        open3d = import_open3d()
        self._core: Any = open3d.core
        self._scene: Any = open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(self._core.Tensor(vertices), self._core.Tensor(triangles.astype(np.uint32)))

    def first_met(self, origins: Array, directions: Array) -> Array:
        """Return the number (n,) of the triangle that each ray meets first, -1 for none."""
        rays = self._core.Tensor(np.hstack([origins, directions]))
        numbers = self._scene.cast_rays(rays)["primitive_ids"].numpy()
        return np.where(numbers == np.iinfo(np.uint32).max, NOTHING_MET, numbers.astype(np.int64))

    def any_met(self, origins: Array, directions: Array, nearest: float, farthest: float) -> Flags:
        """Return whether each ray (n,) meets a triangle between two distances, in lengths of its direction."""
        rays = self._core.Tensor(np.hstack([origins, directions]))
        return np.asarray(self._scene.test_occlusions(rays, tnear=nearest, tfar=farthest).numpy(), dtype=bool)


TriangleRays: TypeAlias = ByEmbreex | ByOpen3d


def triangle_rays(vertices: Array, triangles: Array) -> TriangleRays:
    """Build the search tree of triangles (t, 3) with vertices (v, 3).

    Rays are float32 arrays (n, 3) of origins and directions in the frame of the vertices.

    The wheel of `embreex` carries Embree and needs no library of the system. Where it has no wheel (ARM processors),
    open3d does the work, which carries Embree too.

    Raises
    ------
    MissingLibraryError
        open3d is needed, and a library that it needs is missing.
    """
    kind = ByEmbreex if find_spec("embreex") is not None else ByOpen3d
    return kind(np.ascontiguousarray(vertices, dtype=np.float32), triangles)
