"""The covariance of a robust estimate whose errors are alike on each wall, pooled over all of them.

Where little is in common, a handful of walls carries the pose, and what is wrong with one of them (it is not plane, the
scanner errs at that range and angle) is wrong with all of its points. A jackknife of a handful says little; but how
large such errors are can be learned from all walls together. So each piece of a wall has one error in common, all of
the same variance, which the misfits of the pieces tell once the freedom that the fit took from them is given back.
"""

import numpy as np
from scipy import linalg

from algorithms.arrays import Array, Indices, Labels, Points, Scalars
from algorithms.numbered_rows import numbered_rows
from algorithms.registration.neighbourhood_covariance import influence_matrix

WALL_PIECE_M = 8.0
"""Larger walls count as several pieces of this edge [m]: errors of surfaces are alike over 4 to 10 m."""

LEAST_FREEDOM = 1e-3
"""Where the fit leaves the pieces less of their errors than this, it tells nothing of them."""


def wall_pieces(labels: Labels, positions: Points) -> Indices:
    """Give the number of the piece of a wall, same plane and same cube, that each point belongs to.

    Parameters
    ----------
    labels
        (n,) plane that each point belongs to, -1 for none: then the cube alone counts.
    positions
        (n, 3) points [m].
    """
    cells = np.floor((positions - positions.min(axis=0)) / WALL_PIECE_M).astype(np.int64)
    return numbered_rows(np.column_stack([labels, cells]))[1]


def wall_covariance(design: Array, weights: Scalars, gaps_m: Scalars, pieces: Indices, *, slopes: Scalars) -> Array:
    """Estimate the covariance (k, k) of x in gaps = design x + misfit, one error in common for each piece of a wall.

    With N of `influence_matrix` and, of piece g, W_g = Σ_g w, M_g = Σ_g w a and S_g = Σ_g s a, the mean misfit is
    r_g = Σ_g w v / W_g. Errors e_g of variance τ² change the estimate by N⁻¹ Σ S_g e_g and leave
    r_g = e_g - M_gᵀ N⁻¹ Σ S e / W_g. So τ² = Σ W_g r_g² / tr((I - H)ᵀ W (I - H)) with H = W⁻¹ M N⁻¹ Sᵀ, and
    C = τ² N⁻¹ (Σ S_g S_gᵀ) N⁻¹. O(n k + g k²).

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
    slopes
        (n,) as of `influence_matrix`.
    """
    count, k = int(pieces.max()) + 1, design.shape[1]
    total = np.bincount(pieces, weights, count)
    by_weights, by_slopes = (
        np.stack([np.bincount(pieces, each * design[:, i], count) for i in range(k)], axis=1)
        for each in (weights, slopes)
    )
    used = total > 0.0
    total, by_weights, by_slopes = total[used], by_weights[used], by_slopes[used]
    misfits = np.bincount(pieces, weights * gaps_m, count)[used] / total
    normal_matrix = influence_matrix(design, weights, slopes)
    effects = linalg.solve(normal_matrix, by_slopes.T, assume_a="pos")
    means = linalg.solve(normal_matrix, (by_weights / total[:, None]).T @ by_weights, assume_a="pos")
    taken = 2.0 * np.sum(effects.T * by_weights) - np.trace(means @ effects @ by_slopes)
    variance = float(total @ misfits**2) / max(float(total.sum() - taken), LEAST_FREEDOM * float(total.sum()))
    return np.asarray(variance * effects @ effects.T)


def covering(first: Array, second: Array) -> Array:
    """Give the smallest matrix that is not below either of two covariances.

    In the coordinates in which their sum is the unit matrix both are diagonal: the larger of each pair. What few pieces
    tell has no more rank than they are, so directions in which the sum is nothing but rounding are given that much.
    """
    total = first + second
    values, vectors = np.linalg.eigh(total)
    roots = np.sqrt(np.maximum(values, len(total) * np.finfo(float).eps * values[-1]))
    shares, axes = np.linalg.eigh((vectors / roots).T @ first @ (vectors / roots))
    back = (vectors * roots) @ axes
    return np.asarray((back * np.maximum(shares, 1.0 - shares)) @ back.T)
