"""The covariance of a robust estimate whose errors are alike on each wall, pooled over all of them.

Where little is in common, a handful of walls carries the pose, and what is wrong with one of them (it is not plane, the
scanner errs at that range and angle) is wrong with all of its points. A jackknife of a handful says little; but how
large such errors are can be learned from all walls together. So each piece of a wall has one error in common, all of
the same variance, which the misfits of the pieces tell once the freedom that the fit took from them is given back.
"""

import numpy as np
from scipy import linalg

from algorithms.arrays import Array, Labels, Points, Scalars

WALL_PIECE_M = 8.0
"""Larger walls count as several pieces of this edge [m]: errors of surfaces are alike over 4 to 10 m."""


def wall_pieces(labels: Labels, positions: Points) -> Labels:
    """Give the number of the piece of a wall, same plane and same cube, that each point belongs to.

    Parameters
    ----------
    labels
        (n,) plane that each point belongs to, -1 for none: then the cube alone counts.
    positions
        (n, 3) points [m].
    """
    cells = np.floor((positions - positions.min(axis=0)) / WALL_PIECE_M).astype(np.int64)
    return np.asarray(np.unique(np.column_stack([labels, cells]), axis=0, return_inverse=True)[1].ravel())


def wall_covariance(design: Array, weights: Scalars, gaps_m: Scalars, pieces: Labels, *, bread: float) -> Array:
    """Estimate the covariance (k, k) of x in gaps = design x + misfit, one error in common for each piece of a wall.

    With N = Σ w a aᵀ (times `bread`), m_g = Σ_g w a and W_g = Σ_g w of piece g, its mean misfit is r_g = Σ_g w v / W_g.
    Errors e_g of variance τ² change the estimate by N⁻¹ Σ m_g e_g and leave r = e - A N⁻¹ Σ m_g e_g, A of rows
    m_g / W_g; so τ² = Σ W_g r_g² / tr((I - H)ᵀ W (I - H)) with H = A N⁻¹ Mᵀ, and C = τ² N⁻¹ (Σ m_g m_gᵀ) N⁻¹.
    O(n k + g k²).

    Parameters
    ----------
    design
        (n, k) derivatives of the gaps at the estimate; all k parameters are determined.
    weights
        (n,) weights of the last round, those of a robust estimator included.
    gaps_m
        (n,) misfits at the estimate [m].
    pieces
        (n,) number of the piece that each point belongs to.
    bread
        As of `neighbourhood_covariance`.
    """
    count, k = int(pieces.max()) + 1, design.shape[1]
    total = np.bincount(pieces, weights, count)
    moved = np.stack([np.bincount(pieces, weights * design[:, i], count) for i in range(k)], axis=1)
    used = total > 0.0
    total, moved = total[used], moved[used]
    misfits = np.bincount(pieces, weights * gaps_m, count)[used] / total
    normal_matrix = bread * (design * weights[:, None]).T @ design
    inverse_moved = linalg.solve(normal_matrix, moved.T, assume_a="pos")
    meat = moved.T @ moved
    means = (moved / total[:, None]).T @ moved
    solved = linalg.solve(normal_matrix, meat, assume_a="pos")
    taken = 2.0 * np.trace(solved) - np.trace(linalg.solve(normal_matrix, means, assume_a="pos") @ solved)
    freedom = total.sum() - taken
    variance = float(total @ misfits**2) / max(float(freedom), 1e-3 * float(total.sum()))
    return np.asarray(variance * inverse_moved @ inverse_moved.T)


def covering(first: Array, second: Array) -> Array:
    """Give the smallest matrix that is not below either of two positive definite ones.

    In the coordinates in which the first is the unit matrix and the second diagonal, the larger of each pair.
    """
    values, vectors = linalg.eigh(second, first)
    back = first @ vectors
    return np.asarray((back * np.maximum(values, 1.0)) @ back.T)
