"""Spheres made of an icosahedron, whose triangles are divided into four again and again."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Indices, Points

GOLDEN = 0.5 * (1.0 + 5.0**0.5)
FINEST_LEVEL = 6
"""40 962 cells, 1.1 degrees wide."""


@dataclass(frozen=True, eq=False)
class Tessellation:
    """Cells of a sphere: what lies nearest to one corner of the divided body."""

    centres: Points
    """(n, 3) corners, unit vectors."""
    triangles: Array
    """(t, 3) int64."""
    width_rad: float
    """Mean distance of neighbouring centres [rad]."""
    tree: cKDTree

    def cells_of(self, directions: Points) -> Indices:
        """Give the cell of each unit direction, (k,)."""
        return np.asarray(self.tree.query(directions)[1], dtype=np.int64)

    @property
    def edges(self) -> Array:
        """(e, 2) int64 neighbouring cells, each pair once."""
        pairs = np.vstack([self.triangles[:, [0, 1]], self.triangles[:, [1, 2]], self.triangles[:, [2, 0]]])
        return np.unique(np.sort(pairs, axis=1), axis=0)


@cache
def tessellation(level: int) -> Tessellation:
    """Divide the icosahedron so many times; all new corners are moved out onto the sphere.

    Parameters
    ----------
    level
        0 to `FINEST_LEVEL`: 10 * 4^level + 2 cells.
    """
    if level == 0:
        centres, triangles = _icosahedron()
    else:
        coarser = tessellation(level - 1)
        centres, triangles = _divided(coarser.centres, coarser.triangles)
    edges = centres[triangles[:, 0]] - centres[triangles[:, 1]]
    width = float(2.0 * np.arcsin(0.5 * np.linalg.norm(edges, axis=1)).mean())
    return Tessellation(centres, triangles, width, cKDTree(centres))


def _icosahedron() -> tuple[Array, Array]:
    plane = np.array([[-1.0, GOLDEN], [1.0, GOLDEN], [-1.0, -GOLDEN], [1.0, -GOLDEN]])
    zero = np.zeros((4, 1))
    centres = np.vstack(
        [np.hstack([plane, zero]), np.hstack([zero, plane]), np.hstack([plane[:, 1:], zero, plane[:, :1]])]
    )
    centres /= np.linalg.norm(centres, axis=1, keepdims=True)
    near = np.linalg.norm(centres[:, None] - centres[None], axis=2) < 1.1
    triangles = [
        (i, j, k)
        for i in range(12)
        for j in range(i + 1, 12)
        for k in range(j + 1, 12)
        if near[i, j] and near[j, k] and near[i, k]
    ]
    return centres, np.array(triangles, dtype=np.int64)


def _divided(centres: Array, triangles: Array) -> tuple[Array, Array]:
    sides = np.stack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]], axis=1)
    pairs, numbers = np.unique(np.sort(sides.reshape(-1, 2), axis=1), axis=0, return_inverse=True)
    middles = centres[pairs].sum(axis=1)
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    ab, bc, ca = (numbers.reshape(-1, 3)[:, k] + len(centres) for k in range(3))
    a, b, c = triangles.T
    parts = [np.stack(each, axis=1) for each in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    return np.vstack([centres, middles]), np.vstack(parts).astype(np.int64)
