"""The covariance of a robust estimate whose errors are alike in each neighbourhood, from the misfits themselves.

Thousands of points on one wall are not thousands of observations: what makes one of them lie wrong (an uneven wall, a
bias of the scanner at that angle, the rim of a body) moves its neighbours the same way. So the misfits of one
neighbourhood count as one. How the estimate changes when a neighbourhood is left out is its covariance (jackknife,
Tukey 1958; CR3 of Bell and McCaffrey 2002, who show that plain sandwiches promise too much with few groups), and the
neighbourhoods are made larger while that makes it larger.
"""

from dataclasses import dataclass

import numpy as np
from scipy import linalg

from algorithms.arrays import Array, Points, Scalars
from algorithms.numbered_rows import numbered_rows

EDGE_FACTORS = (2, 4, 8, 16, 32)
"""Edges of the larger neighbourhoods that are tried, over the smallest: a scanner out of adjustment bends whole
streets."""
LEAST_DEGREES = 4.0
"""Larger neighbourhoods that leave fewer degrees of freedom to a motion are not used: their covariance is chance."""
LEAST_NEIGHBOURHOODS = 16
"""Surfaces in fewer neighbourhoods tell too little: ten degrees of freedom more than parameters, as of `adjustment`.
Larger neighbourhoods of which there are fewer are not used."""
LEAST_SLOPE = 0.2
"""Least ratio of slopes to weights along a direction: below it the estimator would hardly hold it."""
LEAST_PIVOT = 1e-6
"""Matrices with a smaller pivot, relative to their diagonal, may be singular."""
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
    slopes: Scalars,
    edge_m: float,
    shifts: Array,
) -> NeighbourhoodCovariance:
    """Estimate the covariance of x in gaps = design x + misfit from the misfits of neighbourhoods.

    With N of `influence_matrix` and, of the points in neighbourhood c, N_c and u_c = Σ w a v: leaving c out changes the
    estimate by -(N - N_c)⁻¹ u_c, and C = (G - 1)/G Σ (N - N_c)⁻¹ u_c u_cᵀ (N - N_c)⁻¹ over G neighbourhoods. Along each
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
    slopes
        (n,) derivatives of the robust estimator's influence function, weights included (`influence_matrix`).
    edge_m
        Edge of the smallest neighbourhoods [m].
    shifts
        (m, k) parameters to shifts: the neighbourhood that does most is the one with the largest effect on them.
    """
    cells, sums = _summed(design, weights, slopes, gaps_m, positions, normals, edge_m)
    normal_matrix = influence_matrix(design, weights, slopes)
    chosen, _ = _at(normal_matrix, sums)
    summed, factor = sums, 1
    if np.isfinite(chosen.variances).all():
        inverse, largest = np.linalg.inv(chosen.matrix), float(design.shape[1])
        for times in EDGE_FACTORS:
            coarser = sums.united(numbered_rows(cells // times)[1])
            found, degrees = _at(normal_matrix, coarser)
            if degrees < LEAST_DEGREES or len(coarser.own) < LEAST_NEIGHBOURHOODS:
                break
            larger = float(np.trace(inverse @ found.matrix))
            if larger > largest:
                chosen, largest, summed, factor = found, larger, coarser, times
    return NeighbourhoodCovariance(
        axes=chosen.axes,
        variances=chosen.variances,
        edge_m=factor * edge_m,
        count=len(summed.own),
        largest_share=_largest_share(normal_matrix, summed.moved, shifts),
    )


def influence_matrix(design: Array, weights: Scalars, slopes: Scalars) -> Array:
    """Give Σ s a aᵀ, the derivative of a robust estimator's equations by the parameters, kept positive definite.

    An estimator that takes less notice of large misfits holds the parameters less firmly than Σ w a aᵀ says (Huber
    1981, ch. 6), and not equally in all directions: where the walls that fix a direction misfit more than the rest,
    much less. Along every direction at least `LEAST_SLOPE` of Σ w a aᵀ is left.

    Parameters
    ----------
    design
        (n, k) derivatives of the gaps.
    weights, slopes
        (n,) w and s of each gap.
    """
    by_weights = (design * weights[:, None]).T @ design
    by_slopes = (design * slopes[:, None]).T @ design
    values, vectors = linalg.eigh(by_slopes, by_weights)
    back = by_weights @ vectors
    return np.asarray((back * np.maximum(values, LEAST_SLOPE)) @ back.T)


@dataclass(frozen=True, eq=False)
class _Sums:
    """What the points of each of g neighbourhoods add up to."""

    own: Array
    """(g, k, k) Σ s a aᵀ with the slopes s."""
    moved: Array
    """(g, k, 3) Σ w a nᵀ."""
    right: Array
    """(g, k) Σ w a v."""

    def united(self, groups: Array) -> "_Sums":
        """Add up neighbourhoods by groups, (g,)."""
        order = np.argsort(groups, kind="stable")
        starts = np.searchsorted(groups[order], np.arange(groups.max() + 1))
        return _Sums(*(np.add.reduceat(each[order], starts) for each in (self.own, self.moved, self.right)))


@dataclass(frozen=True, eq=False)
class _Estimate:
    """Axes and variances as of `NeighbourhoodCovariance`."""

    axes: Array
    variances: Scalars

    @property
    def matrix(self) -> Array:
        """(k, k)."""
        return np.asarray((self.axes * self.variances) @ self.axes.T)


def _summed(
    design: Array,
    weights: Scalars,
    slopes: Scalars,
    gaps_m: Scalars,
    positions: Points,
    normals: Points,
    edge_m: float,
) -> tuple[Array, _Sums]:
    """Sum the points of every cube: its place among cubes (g, 3), and the sums."""
    from algorithms.registration import surface_kernels as kernels

    cubes, groups = numbered_rows(np.floor(positions / edge_m).astype(np.int64))
    sums = kernels.sums_of_groups(np.ascontiguousarray(design), weights, slopes, gaps_m, normals, groups, len(cubes))
    return cubes, _Sums(*sums)


def _at(normal_matrix: Array, sums: _Sums) -> tuple[_Estimate, float]:
    """Estimate with neighbourhoods of one size; give the fewest degrees of freedom of a principal axis too."""
    from algorithms.registration import surface_kernels as kernels

    count, k = sums.right.shape
    changes, solved = kernels.changes_without(normal_matrix, sums.own, sums.right, LEAST_PIVOT)
    # A neighbourhood without which a motion is open leaves a singular matrix: the pseudo-inverse says nothing of that
    # motion then, but the degrees of freedom do, because all its information lies in that neighbourhood.
    without = np.linalg.pinv(normal_matrix - sums.own[~solved], rcond=1e-9, hermitian=True)
    changes[~solved] = np.einsum("gij,gj->gi", without, sums.right[~solved])
    values, axes = np.linalg.eigh((count - 1.0) / count * changes.T @ changes)
    values, axes = np.maximum(values[::-1], 0.0), axes[:, ::-1]
    along = np.linalg.solve(normal_matrix, axes)
    shares = np.sum((sums.own @ along) * along, axis=1)
    shares /= np.sum((normal_matrix @ along) * along, axis=0)
    degrees = 1.0 / np.sum(shares**2, axis=0) - 1.0
    controlled = degrees > NO_DEGREES
    student = degrees / np.where(controlled, degrees - NO_DEGREES, 1.0)
    found = _Estimate(axes, np.where(controlled, values * student, np.inf))
    return found, float(degrees.min()) if k else np.inf


def _largest_share(normal_matrix: Array, moved: Array, shifts: Array) -> Array:
    """Give what a shift of one neighbourhood does to the parameters, (k, 3), of the one whose shift does most."""
    effects = np.linalg.solve(normal_matrix, moved)
    on_shifts = shifts @ effects
    # the largest stretch is no more than the root of the sum of squares, and no less than it over the root of three
    sizes = np.sqrt(np.sum(on_shifts**2, axis=(1, 2)))
    near = np.flatnonzero(sizes >= float(sizes.max()) / 3.0**0.5 * (1.0 - 1e-9))
    most = near[int(np.argmax(np.linalg.norm(on_shifts[near], ord=2, axis=(1, 2))))]
    return np.asarray(effects[most])
