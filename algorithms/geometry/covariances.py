"""Closed forms for intersection lines of planes and their covariance (MATH 2.4)."""

import numpy as np

from algorithms.arrays import Array, Bases, Matrices3, Matrices4, Points
from algorithms.geometry.lines import bases_of


def intersection_lines(
    normals_i: Points, centroids_i: Points, normals_j: Points, centroids_j: Points
) -> tuple[Points, Points]:
    """Intersect pairs of planes.

    Returns
    -------
    Points of the lines nearest to the middle of the two centroids, and unit directions n_i x n_j (MATH 2.4).
    Parallel pairs give non-finite values.
    """
    directions = np.cross(normals_i, normals_j)
    square = np.einsum("ij,ij->i", directions, directions)[:, None]
    middles = 0.5 * (centroids_i + centroids_j)
    gap_i = np.einsum("ij,ij->i", normals_i, centroids_i - middles)[:, None]
    gap_j = np.einsum("ij,ij->i", normals_j, centroids_j - middles)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        points = middles + (gap_i * np.cross(normals_j, directions) + gap_j * np.cross(directions, normals_i)) / square
        units = directions / np.sqrt(square)
    return points, units


def intersection_jacobians(
    anchors: Points,
    directions: Points,
    normals_i: Points,
    centroids_i: Points,
    bases_i: Bases,
    normals_j: Points,
    centroids_j: Points,
    bases_j: Bases,
) -> tuple[Bases, Array]:
    """Differentiate intersection lines by the minimal parameters of their two planes (MATH 2.4).

    With p the anchor, n -> n + E a and c -> c + n b for each plane, the changed line (d + E alpha, p + E beta) fulfils
    n_k.E alpha = -d.E_k a_k and n_k.E beta = b_k - (p - c_k).E_k a_k for k = i, j: two 2x2 systems.

    Returns
    -------
    (n, 3, 2) bases of the lines and (n, 4, 6) Jacobians of (a1, a2, b1, b2) by plane i's (a1, a2, b) and plane j's.
    """
    bases = bases_of(directions)
    system = np.stack([np.einsum("ni,nij->nj", normals_i, bases), np.einsum("ni,nij->nj", normals_j, bases)], axis=1)
    inverse = np.linalg.inv(system)
    n = len(anchors)
    tilt_by_plane = np.zeros((n, 2, 6))
    shift_by_plane = np.zeros((n, 2, 6))
    for row, (centroids, plane_bases) in enumerate(((centroids_i, bases_i), (centroids_j, bases_j))):
        at = 3 * row
        tilt_by_plane[:, row, at : at + 2] = -np.einsum("ni,nij->nj", directions, plane_bases)
        shift_by_plane[:, row, at : at + 2] = -np.einsum("ni,nij->nj", anchors - centroids, plane_bases)
        shift_by_plane[:, row, at + 2] = 1.0
    return bases, np.concatenate([inverse @ tilt_by_plane, inverse @ shift_by_plane], axis=1)


def intersection_covariances(jacobians: Array, covariances_i: Matrices3, covariances_j: Matrices3) -> Matrices4:
    """Propagate the covariances of two independent planes into their intersection: G blkdiag(C_i, C_j) G^T."""
    gi, gj = jacobians[:, :, :3], jacobians[:, :, 3:]
    return np.asarray(gi @ covariances_i @ np.swapaxes(gi, 1, 2) + gj @ covariances_j @ np.swapaxes(gj, 1, 2))
