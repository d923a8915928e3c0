"""What the virtual scanner looks at."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Indices, Points, Scalars
from algorithms.simulation.materials import Material
from algorithms.simulation.parts import CylinderTruth, Part
from algorithms.simulation.unevenness import Unevenness

MIN_DIHEDRAL_RAD = np.deg2rad(10.0)
"""Faces that meet at less than this are one smooth surface."""
ON_FACE_M = 1e-6
"""Within this a point lies on a face."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A triangle mesh with materials and its truth, in world coordinates [m]."""

    name: str
    vertices: Array
    """(v, 3) corners [m]."""
    triangles: Array
    """(t, 3) int64 corner numbers."""
    material_ids: Indices
    """(t,) int64 number of each triangle's material in `materials`."""
    materials: tuple[Material, ...]
    part_edges: Array
    """(e, 2, 3) edges of the single parts, some of them inside a smooth joint; see `scene_edges` [m]."""
    cylinders: tuple[CylinderTruth, ...] = ()
    """Axis pieces and radii of the tubes."""
    stations: tuple[RigidTransform, ...] = ()
    """Recommended set-ups, world from scan; each sees much of what an earlier one sees."""
    unevenness: Unevenness | None = None
    """How the surfaces depart from the mesh, as far as a scanner notices; None: not at all."""

    @cached_property
    def normals(self) -> Points:
        """(t, 3) unit normals of the triangles."""
        a, b, c = (self.vertices[self.triangles[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))

    @cached_property
    def offsets_m(self) -> Scalars:
        """(t,) distances n.x of the triangles' planes from the world's origin [m]."""
        return np.asarray(np.einsum("ij,ij->i", self.normals, self.vertices[self.triangles[:, 0]]))

    @cached_property
    def plane_ids(self) -> Indices:
        """(t,) equal for triangles in one plane (1e-6 in normal and metres), whichever way they face."""
        planes = np.column_stack([self.normals, self.offsets_m])
        leading = np.argmax(np.abs(self.normals) > 0.1, axis=1)
        planes *= np.sign(self.normals[np.arange(len(planes)), leading])[:, None]
        _, ids = np.unique(np.round(planes, 6), axis=0, return_inverse=True)
        return ids.astype(np.int64)

    @cached_property
    def reflectances(self) -> Scalars:
        """(t,) diffuse reflectances of the triangles, 0..1."""
        return np.asarray(np.array([m.reflectance for m in self.materials])[self.material_ids])

    @cached_property
    def is_glass(self) -> Array:
        """(t,) bool, True for panes."""
        return np.asarray(np.array([m.glass for m in self.materials], dtype=bool)[self.material_ids])


def scene_from_parts(name: str, parts: Sequence[Part], stations: Sequence[RigidTransform]) -> Scene:
    """Join parts to a scene."""
    materials = tuple(dict.fromkeys(part.material for part in parts))
    firsts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return Scene(
        name=name,
        vertices=np.concatenate([part.vertices for part in parts]),
        triangles=np.concatenate([part.triangles + first for part, first in zip(parts, firsts[:-1], strict=True)]),
        material_ids=np.concatenate(
            [np.full(len(part.triangles), materials.index(part.material), dtype=np.int64) for part in parts]
        ),
        materials=materials,
        part_edges=np.concatenate([part.edges for part in parts]),
        cylinders=tuple(part.cylinder for part in parts if part.cylinder is not None),
        stations=tuple(stations),
    )


def scene_edges(scene: Scene) -> Array:
    """Give the straight edges of a scene, where faces meet at more than 10 degrees.

    Edges shared by parts are given once; edges of a part that lie in one smooth joint of faces are left out.

    Returns
    -------
    (n, 2, 3) start and end of each edge [m].
    """
    edges = scene.part_edges
    flip = np.array([tuple(b) < tuple(a) for a, b in np.round(edges, 6)], dtype=bool)
    ordered = np.where(flip[:, None, None], edges[:, ::-1], edges)
    _, first = np.unique(np.round(ordered.reshape(-1, 6), 6), axis=0, return_index=True)
    candidates = ordered[np.sort(first)]
    return candidates[[_faces_meet(scene, edge) for edge in candidates]]


def _faces_meet(scene: Scene, edge: Array) -> bool:
    """Tell whether faces of different inclination touch the edge at one of three points inside it."""
    for share in (0.5, 0.21, 0.83):
        normals = scene.normals[triangles_at(scene, edge[0] + share * (edge[1] - edge[0]))]
        if len(normals) and float(np.abs(normals @ normals.T).min()) < np.cos(MIN_DIHEDRAL_RAD):
            return True
    return False


def triangles_at(scene: Scene, point: Array) -> Indices:
    """Find the triangles that contain a point (3,), rim included, within 1 micrometre."""
    near = np.flatnonzero(np.abs(scene.normals @ point - scene.offsets_m) < ON_FACE_M)
    corners = scene.vertices[scene.triangles[near]]
    inside = np.ones(len(near), dtype=bool)
    for k in range(3):
        a, b = corners[:, k], corners[:, (k + 1) % 3]
        inward = np.cross(scene.normals[near], b - a)
        inward /= np.linalg.norm(inward, axis=1, keepdims=True)
        inside &= np.einsum("ij,ij->i", inward, point - a) > -ON_FACE_M
    return near[inside].astype(np.int64)
