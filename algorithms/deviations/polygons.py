"""Divide faces of any number of corners into triangles that cover the face and nothing else."""

import mapbox_earcut
import numpy as np

from algorithms.arrays import Array, Points
from algorithms.geometry.lines import bases_of

AT_ONCE = 1 << 20
"""Corners of faces that are looked at together."""


def triangulated(vertices: Points, corners: Array, counts: Array) -> Array:
    """Return the triangles (t, 3) of faces, in their order and with their sense of turning.

    Quadrilaterals get the diagonal that lies inside. Larger faces are divided from their first corner where it sees all
    others, else clipped ear by ear in their mean plane, which takes time with the square of their corners.

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
    large = np.flatnonzero(counts > 4)
    for faces in (
        np.split(large, np.flatnonzero(np.diff(np.cumsum(counts[large]) // AT_ONCE)) + 1) if len(large) else ()
    ):
        fans, of_fan, hidden = _fans(vertices, corners, starts[faces], counts[faces])
        triangles.append(fans)
        own.append(faces[of_fan])
        for face in faces[hidden].tolist():
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


def _fans(vertices: Points, corners: Array, starts: Array, counts: Array) -> tuple[Array, Array, Array]:
    """Divide faces from their first corner.

    Returns
    -------
    Triangles (t, 3) and the face of each (t,), of faces where all triangles turn alike and their angles at that corner
    are less than half a turn together: they cover the face. Which faces are others (f,).
    """
    sizes = counts - 2
    begins = np.cumsum(sizes) - sizes
    own = np.repeat(np.arange(len(sizes)), sizes)
    first, step = starts[own], np.arange(len(own)) - begins[own]
    fans = corners[np.column_stack([first, first + step + 1, first + step + 2])]
    a, b, c = (vertices[fans[:, k]] for k in range(3))
    doubled = np.cross(b - a, c - a)
    turned = np.einsum("ij,ij->i", doubled, np.add.reduceat(doubled, begins, axis=0)[own])
    angles = np.arctan2(np.linalg.norm(doubled, axis=1), np.einsum("ij,ij->i", b - a, c - a))
    seen = np.minimum.reduceat(turned, begins) > 0.0
    seen &= np.add.reduceat(angles, begins) < np.pi
    return fans[seen[own]], own[seen[own]], ~seen


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
