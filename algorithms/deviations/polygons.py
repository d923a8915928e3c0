"""Divide faces of any number of corners into triangles that cover the face and nothing else."""

import mapbox_earcut
import numpy as np

from algorithms.arrays import Array, Points
from algorithms.geometry.lines import bases_of


def triangulated(vertices: Points, corners: Array, counts: Array) -> Array:
    """Return the triangles (t, 3) of faces, in their order and with their sense of turning.

    Quadrilaterals get the diagonal that lies inside; larger faces are clipped ear by ear in their mean plane.

    Parameters
    ----------
    vertices
        (v, 3) points [m].
    corners
        (c,) numbers of vertices, face after face.
    counts
        (f,) corners of each face; those with less than three are left out.
    """
    starts = np.cumsum(counts) - counts
    own: list[Array] = []
    triangles: list[Array] = []
    threes, fours = np.flatnonzero(counts == 3), np.flatnonzero(counts == 4)
    own += [threes, np.repeat(fours, 2)]
    triangles += [corners[starts[threes][:, None] + np.arange(3)], _halves(vertices, corners, starts[fours])]
    for face in np.flatnonzero(counts > 4).tolist():
        ring = corners[starts[face] : starts[face] + counts[face]]
        ears = _ears(vertices[ring])
        triangles.append(ring[ears])
        own.append(np.full(len(ears), face))
    order = np.argsort(np.concatenate(own), kind="stable")
    return np.asarray(np.concatenate(triangles)[order], dtype=np.int64)


def _halves(vertices: Points, corners: Array, starts: Array) -> Array:
    """Divide quadrilaterals by the diagonal from their first corner, or else by the other one."""
    four = corners[starts[:, None] + np.arange(4)]
    a, b, c, d = (vertices[four[:, k]] for k in range(4))
    folded = np.einsum("ij,ij->i", np.cross(b - a, c - a), np.cross(c - a, d - a)) < 0.0
    first = np.where(folded[:, None], four[:, [0, 1, 3]], four[:, [0, 1, 2]])
    second = np.where(folded[:, None], four[:, [1, 2, 3]], four[:, [0, 2, 3]])
    return np.stack([first, second], axis=1).reshape(-1, 3)


def _ears(ring: Points) -> Array:
    """Return the triangles of one face as numbers of its corners; none where it has no area."""
    following = np.roll(ring, -1, axis=0)
    normal = np.cross(ring - ring[0], following - ring[0]).sum(axis=0)
    length = float(np.linalg.norm(normal))
    if not np.isfinite(length) or length == 0.0:
        return np.empty((0, 3), dtype=np.int64)
    flat = np.ascontiguousarray((ring - ring[0]) @ bases_of((normal / length)[None])[0])
    ears = mapbox_earcut.triangulate_float64(flat, np.array([len(ring)], dtype=np.uint32)).astype(np.int64)
    ears = ears.reshape(-1, 3)
    sides = ring[ears[:, 1:]] - ring[ears[:, :1]]
    turned = np.cross(sides[:, 0], sides[:, 1]) @ normal < 0.0
    ears[turned] = ears[turned][:, ::-1]
    return ears
