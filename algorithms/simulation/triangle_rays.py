"""Rays against triangles, by Embree in single precision or by the service's own tree."""

from importlib.util import find_spec
from typing import Any, TypeAlias

import numpy as np

from algorithms.arrays import Array, Flags
from algorithms.scans.triangle_tree import TriangleTree

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


class ByTree:
    """Rays by the service's own tree, likewise."""

    def __init__(self, vertices: Array, triangles: Array) -> None:
        self._tree = TriangleTree(vertices, triangles)

    def first_met(self, origins: Array, directions: Array) -> Array:
        """Return the number (n,) of the triangle that each ray meets first, -1 for none."""
        return self._tree.first_hits(origins, directions)

    def any_met(self, origins: Array, directions: Array, nearest: float, farthest: float) -> Flags:
        """Return whether each ray (n,) meets a triangle between two distances, in lengths of its direction."""
        return self._tree.meets_any(origins, directions, nearest, farthest)


TriangleRays: TypeAlias = ByEmbreex | ByTree


def triangle_rays(vertices: Array, triangles: Array) -> TriangleRays:
    """Build the search tree of triangles (t, 3) with vertices (v, 3).

    Rays are float32 arrays (n, 3) of origins and directions in the frame of the vertices.

    The wheel of `embreex` carries Embree and needs no library of the system. Where it has no wheel (ARM processors),
    the service's own tree does the work.
    """
    kind = ByEmbreex if find_spec("embreex") is not None else ByTree
    return kind(np.ascontiguousarray(vertices, dtype=np.float32), triangles)
