"""Triangle meshes: what is wrong with one, where a point is nearest to a triangle, and which side that is."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float64, Int64

from algorithms.arrays import Array, Points
from algorithms.errors import InvalidInputError

FACE, EDGE_AB, EDGE_BC, EDGE_CA, CORNER_A, CORNER_B, CORNER_C = range(7)
"""The parts of a triangle that a nearest place can lie on."""
NO_TRIANGLE = "it has no triangle with an area"


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles with the vertices they share."""

    vertices: Float64[Array, "v 3"]
    """(v, 3) [m]."""
    triangles: Int64[Array, "t 3"]
    """(t, 3) vertices of each, anticlockwise as seen from outside."""


@dataclass(frozen=True)
class MeshCondition:
    """What a mesh's edges say of it."""

    border_edges: int
    """Edges of one triangle only: rims of holes, or of an open surface."""
    crowded_edges: int
    """Edges of three triangles or more."""
    contradicting_edges: int
    """Edges whose two triangles look to opposite sides."""
    dropped_triangles: int
    """Triangles without area, which were left out."""

    @property
    def is_closed(self) -> bool:
        """Whether it bounds a body, so that inside and outside exist."""
        return self.border_edges == self.crowded_edges == self.contradicting_edges == 0


def cleaned(vertices: Array, triangles: Array) -> tuple[Mesh, int]:
    """Unite equal vertices and drop triangles without area; O(v log v).

    STL has three vertices of its own for each triangle: only united ones have edges in common.

    Parameters
    ----------
    vertices, triangles
        (v, 3) and (t, 3) as read.

    Returns
    -------
    The mesh, and how many triangles were dropped.

    Raises
    ------
    InvalidInputError
        Where nothing is left, a vertex is not finite, or a triangle names a vertex that does not exist.
    """
    if not len(triangles) or not len(vertices):
        raise InvalidInputError("mesh", NO_TRIANGLE, "export it with its faces, not its points only")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise InvalidInputError("mesh", "a triangle names a vertex that does not exist")
    if not np.isfinite(vertices).all():
        raise InvalidInputError("mesh", "a vertex has a coordinate that is no finite number")
    united, numbers = np.unique(np.asarray(vertices, dtype=np.float64), axis=0, return_inverse=True)
    corners = numbers.ravel()[np.asarray(triangles, dtype=np.int64)]
    sides = united[corners[:, 1:]] - united[corners[:, :1]]
    area = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    longest = np.max(np.sum(sides**2, axis=2), axis=1, initial=0.0)
    good = area > 1e-12 * longest
    if not good.any():
        raise InvalidInputError("mesh", NO_TRIANGLE, "export it with its faces, not its points only")
    return Mesh(united, np.ascontiguousarray(corners[good])), int((~good).sum())


def condition_of(mesh: Mesh, dropped: int = 0) -> MeshCondition:
    """Count the edges that a closed, consistently oriented surface does not have; O(t log t)."""
    _, turns, counts = _edges(mesh)
    return MeshCondition(
        border_edges=int((counts == 1).sum()),
        crowded_edges=int((counts > 2).sum()),
        contradicting_edges=int(((counts == 2) & (turns != 0)).sum()),
        dropped_triangles=dropped,
    )


def _edges(mesh: Mesh) -> tuple[Array, Array, Array]:
    """Give for each side AB, BC, CA of the triangles its edge (t, 3), and for edges their net sense and their count."""
    ends = np.stack([mesh.triangles, np.roll(mesh.triangles, -1, axis=1)], axis=2).reshape(-1, 2)
    keys = np.sort(ends, axis=1) @ np.array([len(mesh.vertices), 1])
    _, numbers, counts = np.unique(keys, return_inverse=True, return_counts=True)
    turns = np.bincount(numbers.ravel(), np.where(ends[:, 0] < ends[:, 1], 1.0, -1.0))
    return numbers.reshape(-1, 3), turns, counts


def edge_normals(mesh: Mesh) -> tuple[Float64[Array, "t 7 3"], Bool[Array, "t 7"]]:
    """Give the pseudonormals of each triangle's seven parts, and which parts lie on a border.

    A face has its normal, an edge the sum of those of its faces, a corner the sum weighted by the faces' angles there
    (Bærentzen and Aanæs 2005). O(t log t).
    """
    corners = mesh.vertices[mesh.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # a triangle without area, as reconstructions leave some, has no side, and takes none from those beside it
    normals /= np.maximum(np.linalg.norm(normals, axis=1), np.finfo(np.float64).tiny)[:, None]
    numbers, _, counts = _edges(mesh)
    of_edges, of_vertices = np.zeros((len(counts), 3)), np.zeros((len(mesh.vertices), 3))
    for k in range(3):
        np.add.at(of_edges, numbers[:, k], normals)
        there, back = (corners[:, (k + step) % 3] - corners[:, k] for step in (1, 2))
        angles = np.arctan2(np.linalg.norm(np.cross(there, back), axis=1), np.einsum("ij,ij->i", there, back))
        np.add.at(of_vertices, mesh.triangles[:, k], angles[:, None] * normals)
    on_border = np.zeros(len(mesh.vertices), dtype=np.bool_)
    for k in range(3):
        lone = counts[numbers[:, k]] == 1
        on_border[mesh.triangles[lone, k]] = True
        on_border[mesh.triangles[lone, (k + 1) % 3]] = True
    all_normals = np.concatenate([normals[:, None], of_edges[numbers], of_vertices[mesh.triangles]], axis=1)
    bordering = np.concatenate(
        [np.zeros((len(normals), 1), dtype=np.bool_), counts[numbers] == 1, on_border[mesh.triangles]], axis=1
    )
    return all_normals, bordering


def closest_on_triangles(
    points: Points, corners: Float64[Array, "n 3 3"]
) -> tuple[Float64[Array, "n 3"], Int64[Array, "n"]]:
    """Give the place of each triangle that is nearest to its point, and the part it lies on (Ericson 2005, 5.1.5).

    Parameters
    ----------
    points
        (n, 3) points [m].
    corners
        (n, 3, 3) corners A, B, C of one triangle for each point [m].
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, ac = b - a, c - a

    def dot(u: Array, v: Array) -> Array:
        return np.asarray(np.einsum("ij,ij->i", u, v))

    d1, d2 = dot(ab, points - a), dot(ac, points - a)
    d3, d4 = dot(ab, points - b), dot(ac, points - b)
    d5, d6 = dot(ab, points - c), dot(ac, points - c)
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    with np.errstate(divide="ignore", invalid="ignore"):
        on_ab, on_ac = d1 / (d1 - d3), d2 / (d2 - d6)
        on_bc = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v, w = vb / (va + vb + vc), vc / (va + vb + vc)
    cases = [
        ((d1 <= 0.0) & (d2 <= 0.0), a, CORNER_A),
        ((d3 >= 0.0) & (d4 <= d3), b, CORNER_B),
        ((d6 >= 0.0) & (d5 <= d6), c, CORNER_C),
        ((vc <= 0.0) & (d1 >= 0.0) & (d3 <= 0.0), a + on_ab[:, None] * ab, EDGE_AB),
        ((vb <= 0.0) & (d2 >= 0.0) & (d6 <= 0.0), a + on_ac[:, None] * ac, EDGE_CA),
        ((va <= 0.0) & (d4 >= d3) & (d5 >= d6), b + on_bc[:, None] * (c - b), EDGE_BC),
    ]
    places = a + v[:, None] * ab + w[:, None] * ac
    parts = np.full(len(points), FACE, dtype=np.int64)
    open_ = np.ones(len(points), dtype=np.bool_)
    for condition, place, part in cases:
        here = open_ & condition
        places[here], parts[here] = place[here], part
        open_ &= ~condition
    return places, parts
