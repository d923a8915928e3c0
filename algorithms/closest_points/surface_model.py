"""A surface as points with normals and curvatures, and what is nearest on it."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from algorithms.arrays import Array, Points, Scalars

NEIGHBOURS = 12
"""Of which the curvatures of a point are told."""
LARGEST_RADIUS_M = 1e6
"""Flatter surfaces are planes [m]."""


@dataclass(frozen=True, eq=False)
class SurfaceModel:
    """n points of a surface with its normals and principal curvatures."""

    points: Points
    normals: Points
    """(n, 3) unit normals."""
    axes: Array
    """(n, 2, 3) principal directions."""
    radii_m: Array
    """(n, 2) radii of curvature along them, as absolute values [m]."""
    tree: cKDTree

    @staticmethod
    def of(points: Points, normals: Points) -> "SurfaceModel":
        """Tell principal directions and radii by how the normals of neighbours turn.

        Parameters
        ----------
        points, normals
            (n, 3) points [m] and their unit normals.
        """
        tree = cKDTree(points)
        count = min(NEIGHBOURS, len(points))
        near = np.asarray(tree.query(points, count)[1], dtype=np.int64).reshape(len(points), count)
        least = np.argmin(np.abs(normals), axis=1)
        first = np.cross(normals, np.eye(3)[least])
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        bases = np.stack([first, np.cross(normals, first)], axis=1)
        steps = np.einsum("nki,nji->nkj", points[near] - points[:, None], bases)
        turns = np.einsum("nki,nji->nkj", normals[near] - normals[:, None], bases)
        scatter = np.einsum("nki,nkj->nij", steps, steps)
        scatter += 1e-9 * np.maximum(np.einsum("nii->n", scatter), 1e-12)[:, None, None] * np.eye(2)
        shape = np.linalg.solve(scatter, np.einsum("nki,nkj->nij", steps, turns))
        curvatures, vectors = np.linalg.eigh(0.5 * (shape + np.swapaxes(shape, 1, 2)))
        axes = np.einsum("nji,njk->nik", vectors, bases)
        radii = np.minimum(1.0 / np.maximum(np.abs(curvatures), 1.0 / LARGEST_RADIUS_M), LARGEST_RADIUS_M)
        return SurfaceModel(points, normals, axes, radii, tree)

    def nearest(self, points: Points, max_distance_m: float) -> tuple[Array, Array]:
        """Pair points with the nearest ones of the surface: numbers of the points that have one near, and of theirs.

        Parameters
        ----------
        points
            (m, 3) [m].
        max_distance_m
            Farther ones have none [m].
        """
        distances, found = self.tree.query(points, distance_upper_bound=max_distance_m)
        near = np.flatnonzero(np.isfinite(distances))
        return near.astype(np.int64), np.asarray(found, dtype=np.int64)[near]


def stiffness(distances_m: Scalars, radii_m: Array) -> Array:
    """Give d/(d + radius) of Hofer and Pottmann's equation (21), (n, 2): 0 on the surface or a plane, 1 far away.

    Parameters
    ----------
    distances_m
        (n,) distances from the surface [m].
    radii_m
        (n, 2) radii of curvature, as absolute values [m].
    """
    away = np.abs(distances_m)[:, None]
    return np.asarray(away / (away + radii_m))
