"""Triangle meshes of simple bodies, each of one material, with their straight edges."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Array, Points
from algorithms.simulation.materials import Material

HEXAHEDRON_FACES = {
    "bottom": (0, 3, 2, 1),
    "top": (4, 5, 6, 7),
    "front": (0, 1, 5, 4),
    "right": (1, 2, 6, 5),
    "back": (2, 3, 7, 6),
    "left": (3, 0, 4, 7),
}
"""Corner numbers of each face, anticlockwise seen from outside."""


@dataclass(frozen=True)
class CylinderTruth:
    """The true axis piece and radius of a tube, in world coordinates."""

    start_m: tuple[float, float, float]
    end_m: tuple[float, float, float]
    radius_m: float


@dataclass(frozen=True, eq=False)
class Part:
    """A mesh of one material, in world coordinates."""

    vertices: Points
    """(v, 3) corners [m]."""
    triangles: Array
    """(t, 3) int64 corner numbers."""
    edges: Array
    """(e, 2, 3) straight edges, start and end [m]; none for the facets of curved surfaces."""
    material: Material
    cylinder: CylinderTruth | None = None
    """Truth of a tube."""


def polygons(rings: Iterable[Array], material: Material, *, with_edges: bool = True) -> Part:
    """Build a part of plane convex polygons.

    Parameters
    ----------
    rings
        Corner rings, each (k, 3) [m], k >= 3.
    material
        Of all polygons.
    with_edges
        Whether the rings' sides are edges of the part.
    """
    corners = [np.asarray(ring, dtype=np.float64) for ring in rings]
    triangles: list[Array] = []
    edges: list[Array] = []
    first = 0
    for ring in corners:
        fan = np.arange(1, len(ring) - 1)
        triangles.append(first + np.column_stack([np.zeros_like(fan), fan, fan + 1]))
        edges.append(np.stack([ring, np.roll(ring, -1, axis=0)], axis=1))
        first += len(ring)
    return Part(
        vertices=np.concatenate(corners),
        triangles=np.concatenate(triangles).astype(np.int64),
        edges=np.concatenate(edges) if with_edges else np.empty((0, 2, 3)),
        material=material,
    )


def hexahedron(corners: Array, material: Material, omit: Collection[str] = ()) -> Part:
    """Build a body with six plane faces.

    Parameters
    ----------
    corners
        (8, 3) the bottom ring anticlockwise seen from above, then the top ring above it [m].
    material
        Of all faces.
    omit
        Names of faces to leave open (see `HEXAHEDRON_FACES`), where another body joins.
    """
    corners = np.asarray(corners, dtype=np.float64)
    return polygons([corners[list(ring)] for name, ring in HEXAHEDRON_FACES.items() if name not in omit], material)


def box(
    low_m: tuple[float, float, float],
    high_m: tuple[float, float, float],
    material: Material,
    *,
    turn_rad: float = 0.0,
    omit: Collection[str] = (),
) -> Part:
    """Build a box between two corners, turned about the vertical through its centre."""
    (x0, y0, z0), (x1, y1, z1) = low_m, high_m
    ring = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    centre = ring.mean(axis=0)
    cosine, sine = np.cos(turn_rad), np.sin(turn_rad)
    ring = centre + (ring - centre) @ np.array([[cosine, sine], [-sine, cosine]])
    corners = np.vstack([np.column_stack([ring, np.full(4, z)]) for z in (z0, z1)])
    return hexahedron(corners, material, omit)


def slab(ring: Array, thickness_m: Array, material: Material, omit: Collection[str] = ()) -> Part:
    """Build a plate: a quadrangle (4, 3), anticlockwise seen from above, thickened by a vector (3,) [m]."""
    ring = np.asarray(ring, dtype=np.float64)
    return hexahedron(np.vstack([ring, ring + np.asarray(thickness_m, dtype=np.float64)]), material, omit)


def path_of_boxes(
    points_m: Iterable[tuple[float, float]], width_m: float, height_m: float, material: Material
) -> list[Part]:
    """Build a free-standing wall on the ground along a polyline (butt joints)."""
    parts = []
    for start, end in pairwise(np.asarray(p, dtype=np.float64) for p in points_m):
        along = (end - start) / np.linalg.norm(end - start)
        across = 0.5 * width_m * np.array([-along[1], along[0]])
        ring = np.array([start - across, end - across, end + across, start + across])
        corners = np.vstack([np.column_stack([ring, np.full(4, z)]) for z in (0.0, height_m)])
        parts.append(hexahedron(corners, material))
    return parts


def moved(parts: Iterable[Part], world_from_part: RigidTransform) -> list[Part]:
    """Move parts rigidly."""

    def at(point: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = (float(v) for v in world_from_part.apply(np.asarray(point)))
        return x, y, z

    return [
        replace(
            part,
            vertices=world_from_part.apply(part.vertices),
            edges=world_from_part.apply(part.edges.reshape(-1, 3)).reshape(-1, 2, 3),
            cylinder=None
            if part.cylinder is None
            else replace(part.cylinder, start_m=at(part.cylinder.start_m), end_m=at(part.cylinder.end_m)),
        )
        for part in parts
    ]
