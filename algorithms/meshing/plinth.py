"""Stand a free-form surface on a convex body of planes, and make one watertight body of both.

The source models plinth and sculpture apart, split by a plane little above the top of the plinth (Haring 2003, 5.3.1),
because a surface that smooths noise rounds the corner in which they meet.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from algorithms.arrays import Array, Points, Vector3
from algorithms.deviations.signed_distances import inside_polygon
from algorithms.deviations.triangles import Mesh
from algorithms.errors import InvalidInputError
from algorithms.meshing.reconstruction import used_vertices
from algorithms.meshing.repair import across, caps_of, cut_open

SMALL = 1e-9
"""Of the largest coordinate: corners this near to a plane lie in it."""
FLATTEST_CORNER = 1e-6
"""Three normals that span a smaller volume meet in no corner."""
LEAST_PLANES, MOST_PLANES = 4, 60


@dataclass(frozen=True, eq=False)
class Plinth:
    """A convex body of planes, one of which carries the surface."""

    points_m: Points
    """(k, 3) a point of each plane [m]."""
    normals: Points
    """(k, 3) unit normals, to the outside."""
    top: int
    """The plane that carries."""


def standing_on(mesh: Mesh, plinth: Plinth, above_m: float) -> Mesh:
    """Join a surface and the body it stands on.

    The surface is cut in parallel with the top; from the rims walls go down to the top, whose face is triangulated
    around them: no face is left inside.

    Parameters
    ----------
    mesh
        The surface; whether it holds the plinth itself or ends there does not matter, what lies below the cut goes.
    plinth
        The body.
    above_m
        Height above the top at which the surface is cut [m].

    Raises
    ------
    InvalidInputError
        The planes bound no body, or the surface does not rise within the top from it.
    """
    corners, faces = _body(plinth)
    normal = plinth.normals[plinth.top]
    cut_at = plinth.points_m[plinth.top] + above_m * normal
    upper, rims = cut_open(mesh, cut_at, normal)
    if not rims:
        raise InvalidInputError("plinth", "the surface does not reach its top", "a smaller `above_m`, or other planes")
    vertices, triangles, feet = [upper.vertices], [upper.triangles], []
    count = len(upper.vertices)
    for rim in rims:
        foot = np.arange(count, count + len(rim))
        vertices.append(upper.vertices[rim] - above_m * normal)
        onward, foot_onward = np.roll(rim, -1), np.roll(foot, -1)
        triangles += [np.column_stack([rim, onward, foot_onward]), np.column_stack([rim, foot_onward, foot])]
        feet.append(foot)
        count += len(rim)
    vertices.append(corners)
    everything = np.concatenate(vertices)
    for plane, face in faces.items():
        outline = face + count
        if plane == plinth.top:
            triangles += _around(everything, outline, feet, normal)
        else:
            triangles.append(np.column_stack([np.full(len(face) - 2, outline[0]), outline[1:-1], outline[2:]]))
    return used_vertices(Mesh(everything, np.concatenate(triangles).astype(np.int64)))


def _around(vertices: Points, outline: Array, feet: Sequence[Array], normal: Vector3) -> Sequence[Array]:
    """Triangulate the top face around the feet of the rims; within a rim that lies in another one is top again."""
    flat = (vertices - vertices[outline[0]]) @ across(normal)
    if not inside_polygon(flat[np.concatenate(feet)], flat[outline]).all():
        raise InvalidInputError(
            "plinth", "the surface reaches beyond its top", "crop (`cleaning.box`) to what stands on it"
        )
    caps = caps_of([outline, *feet], flat)
    corners = [flat[cap] for cap in caps]
    turns = [
        np.sum(np.linalg.det(np.stack([each[:, 1] - each[:, 0], each[:, 2] - each[:, 0]], axis=1))) for each in corners
    ]
    return [cap if turn >= 0.0 else cap[:, ::-1] for cap, turn in zip(caps, turns, strict=True)]


def _body(plinth: Plinth) -> tuple[Points, Mapping[int, Array]]:
    """Give the corners (c, 3) and of every plane those of its face, anticlockwise as seen from outside.

    By all triples of planes; a corner lies behind every other plane.
    """
    normals, offsets = plinth.normals, np.einsum("ij,ij->i", plinth.normals, plinth.points_m)
    if not LEAST_PLANES <= len(normals) <= MOST_PLANES:
        raise InvalidInputError("plinth", f"{len(normals)} planes", f"{LEAST_PLANES} to {MOST_PLANES}")
    triples = np.array(list(combinations(range(len(normals)), 3)))
    triples = triples[np.abs(np.linalg.det(normals[triples])) > FLATTEST_CORNER]
    corners = np.linalg.solve(normals[triples], offsets[triples][:, :, None])[:, :, 0]
    near = SMALL * float(np.abs(corners).max(initial=1.0))
    corners = corners[(corners @ normals.T <= offsets + near).all(axis=1)]
    _, first = np.unique(np.round(corners / (10.0 * near)), axis=0, return_index=True)
    corners = corners[np.sort(first)]
    faces: dict[int, Array] = {}
    for plane in range(len(normals)):
        own = np.flatnonzero(np.abs(corners @ normals[plane] - offsets[plane]) <= 2.0 * near)
        if len(own) >= 3:
            x, y = ((corners[own] - corners[own].mean(axis=0)) @ across(normals[plane])).T
            faces[plane] = own[np.argsort(np.arctan2(y, x))]
    edges = sum(len(face) for face in faces.values())
    if plinth.top not in faces or 2 * len(corners) - edges + 2 * len(faces) != 4:  # Euler's formula
        raise InvalidInputError(
            "plinth", "its planes bound no body", "normals must look outward, and planes close it on all sides"
        )
    return corners, faces
