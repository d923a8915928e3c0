"""The covariance of a robust estimate whose errors are alike in each neighbourhood, from the misfits themselves.

Thousands of points on one wall are not thousands of observations: what makes one of them lie wrong (an uneven wall, a
bias of the scanner at that angle, the rim of a body) moves its neighbours the same way. So the misfits of one
neighbourhood count as one. How the estimate changes when a neighbourhood is left out is its covariance (jackknife,
Tukey 1958; CR3 of Bell and McCaffrey 2002, who show that plain sandwiches promise too much with few groups), and the
neighbourhoods are made larger while that makes it larger.
"""

from dataclasses import dataclass

import numpy as np

from algorithms.arrays import Array, Points, Scalars

EDGE_FACTORS = (2.0, 4.0, 8.0)
"""Edges of the larger neighbourhoods that are tried, over the smallest."""
LEAST_DEGREES = 4.0
"""Larger neighbourhoods that leave fewer degrees of freedom to a motion are not used: their covariance is chance."""
NO_DEGREES = 2.0
"""At so few degrees of freedom Student's distribution has no variance: nothing controls that motion."""


@dataclass(frozen=True, eq=False)
class NeighbourhoodCovariance:
    """Covariance of k parameters along its principal axes, largest first."""

    axes: Array
    """(k, k) unit axes as columns."""
    variances: Scalars
    """(k,) variance along each, inf where too few neighbourhoods speak."""
    edge_m: float
    """Edge of the neighbourhoods [m]."""
    count: int
    """How many neighbourhoods there are."""
    largest_share: Array
    """(k, 3) what a shift of all points of one neighbourhood by one metre along each axis of the frame does to the
    parameters, of the neighbourhood where it does most."""


def neighbourhood_covariance(
    design: Array,
    weights: Scalars,
    gaps_m: Scalars,
    positions: Points,
    normals: Points,
    *,
    bread: float,
    edge_m: float,
    shifts: Array,
) -> NeighbourhoodCovariance:
    """Estimate the covariance of x in gaps = design x + misfit from the misfits of neighbourhoods.

    With N = Σ w a aᵀ and, of the points in neighbourhood c, N_c and u_c = Σ w a v: leaving c out changes the estimate
    by -(N - N_c)⁻¹ u_c, and C = (G - 1)/G Σ (N - N_c)⁻¹ u_c u_cᵀ (N - N_c)⁻¹ over G neighbourhoods. Along each
    principal axis the neighbourhoods count by their shares p_c of the information, G' = 1/Σ p_c², and the variance is
    multiplied by that of Student's distribution with ν = G' - 1 degrees of freedom, ν/(ν - 2).

    Parameters
    ----------
    design
        (n, k) derivatives of the gaps at the estimate; all k parameters are determined.
    weights
        (n,) weights of the last round, those of a robust estimator included.
    gaps_m
        (n,) misfits at the estimate [m].
    positions, normals
        (n, 3) where the misfits are and in which direction they are measured.
    bread
        Mean derivative of the robust estimator's influence function over its mean weight: the normal matrix of an
        estimator that takes less notice of large misfits is smaller by that factor (Huber 1981, ch. 6).
    edge_m
        Edge of the smallest neighbourhoods [m].
    shifts
        (m, k) parameters to shifts: the neighbourhood that does most is the one with the largest effect on them.
    """
    normal_matrix = bread * (design * weights[:, None]).T @ design

    def at(edge: float) -> tuple[NeighbourhoodCovariance, float]:
        return _at(normal_matrix, bread, design, weights, gaps_m, normals, _groups(positions, edge), edge, shifts)

    chosen, _ = at(edge_m)
    if not np.isfinite(chosen.variances).all():
        return chosen
    inverse, largest = np.linalg.inv(_matrix(chosen)), float(design.shape[1])
    for factor in EDGE_FACTORS:
        found, degrees = at(factor * edge_m)
        if degrees < LEAST_DEGREES:
            break
        larger = float(np.trace(inverse @ _matrix(found)))
        if larger > largest:
            chosen, largest = found, larger
    return chosen


def _groups(positions: Points, edge_m: float) -> Array:
    """Find for each point the number of the cube that it lies in, (n,)."""
    cells = np.floor(positions / edge_m).astype(np.int64)
    cells -= cells.min(axis=0)
    # one number for each cube: rows are much slower to sort
    keys = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
    return np.unique(keys, return_inverse=True)[1]


def _at(
    normal_matrix: Array,
    bread: float,
    design: Array,
    weights: Scalars,
    gaps_m: Scalars,
    normals: Points,
    groups: Array,
    edge_m: float,
    shifts: Array,
) -> tuple[NeighbourhoodCovariance, float]:
    """Estimate with neighbourhoods of one size; give the fewest degrees of freedom of a principal axis too."""
    count, k = int(groups.max()) + 1, design.shape[1]
    weighted = design * weights[:, None]
    own = _sums(weighted[:, :, None] * design[:, None, :], groups, count)
    moved = _sums(weighted[:, :, None] * normals[:, None, :], groups, count)
    right = _sums(weighted * gaps_m[:, None], groups, count)
    without = normal_matrix - bread * own
    # A neighbourhood without which a motion is open leaves a singular matrix: the pseudo-inverse says nothing of that
    # motion then, but the degrees of freedom do, because all its information lies in that neighbourhood.
    changes = np.einsum("gij,gj->gi", np.linalg.pinv(without, rcond=1e-9, hermitian=True), right)
    values, axes = np.linalg.eigh((count - 1.0) / count * changes.T @ changes)
    values, axes = np.maximum(values[::-1], 0.0), axes[:, ::-1]
    along = np.linalg.solve(normal_matrix, axes)
    shares = np.einsum("ik,gij,jk->gk", along, bread * own, along)
    shares /= np.einsum("ik,ij,jk->k", along, normal_matrix, along)
    degrees = 1.0 / np.sum(shares**2, axis=0) - 1.0
    controlled = degrees > NO_DEGREES
    student = degrees / np.where(controlled, degrees - NO_DEGREES, 1.0)
    effects = np.linalg.solve(normal_matrix, moved)
    most = int(np.argmax(np.linalg.norm(shifts @ effects, ord=2, axis=(1, 2))))
    found = NeighbourhoodCovariance(
        axes=axes,
        variances=np.where(controlled, values * student, np.inf),
        edge_m=edge_m,
        count=count,
        largest_share=effects[most],
    )
    return found, float(degrees.min()) if k else np.inf


def _matrix(found: NeighbourhoodCovariance) -> Array:
    return np.asarray((found.axes * found.variances) @ found.axes.T)


def _sums(values: Array, groups: Array, count: int) -> Array:
    """Add up the rows of each group."""
    flat = values.reshape(len(values), -1)
    total = np.stack([np.bincount(groups, weights=column, minlength=count) for column in flat.T], axis=1)
    return total.reshape(count, *values.shape[1:])
