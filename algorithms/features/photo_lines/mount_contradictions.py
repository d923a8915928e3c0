"""What a station tells of its cameras' mounts by itself: lines that both its scan and its photos show (MATH 2.8).

Scan and camera stand together, so the lines that both see need no registration to be compared. With x₁ the scan's line,
x₂ the photo's, and H the tilt and offset across the projecting plane, which no error of the surface beside the edge
touches (`same_lines.across_surfaces`),

    z = H (x₂ - x₁) = H M m + H e₂ + H r - H G p,      m ~ (0, C_m)

with the mount's error m, the edge's e₂, r for rounding, which is common to all that photos show of the line, and the
planes' p, which many lines share. In units of a loose prior L (m = L y)
the lines determine the combinations Vᵀ y with eigenvalues λ > 1 of N = (M L)ᵀ Σ⁻¹ (M L); these have the estimate
u = λ⁻¹ Vᵀ (M L)ᵀ Σ⁻¹ z with the covariance λ⁻¹, and T = uᵀ (λ⁻¹ + Vᵀ L⁻¹ C_m L⁻ᵀ V)⁻¹ u ~ χ².

Which lines are the same must be found without trusting the stated mounts: pairs are taken up to the loose prior, and
the mount that most of them support is found by hypotheses from two pairs each and reweighted iterations. Unless it
explains several lines that the stated mount leaves open, the stated one is kept, with the lines that fit it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from jaxtyping import Float64, Int64
from scipy.linalg import block_diag

from algorithms.arrays import Array, Matrix6
from algorithms.features.mount_test import MountTest
from algorithms.features.photo_lines.projected_edges import ProjectedEdges
from algorithms.features.photo_lines.projection_options import MergeOptions
from algorithms.features.photo_lines.same_lines import across_surfaces, near_pairs, rounding_covariances
from algorithms.geometry.lines import Lines
from algorithms.probabilities import chi2_ppf

GON = np.pi / 200.0
LOOSE_STD = np.array([0.2 * GON] * 3 + [0.02] * 3)
"""Errors of mounts that are looked for [rad, m]: larger ones would have to be found by other means."""
ALPHA = 0.001
"""Probability that good mounts are called wrong."""
OUTLIER = float(chi2_ppf(0.999, 2))
"""Pairs that fit the mount worse show different lines."""
SEEDS = 16
"""Mounts are tried from pairs among so many of the most certain ones."""
MIN_PAIRS = 4
"""Fewer lines cannot tell a wrong mount from a line that shows something else: three determine a mount unchecked."""
MIN_GAIN = 3.0 * OUTLIER
"""A wrong mount must explain three lines more than the stated one: one or two may show something else."""
EXACT = 1e-8
"""Share of the loose covariance that is added to stated ones, which may be zero."""
ROUNDS = 10
"""Of reweighting; it has settled before."""


@dataclass(frozen=True, eq=False)
class _Scan:
    """What the scan says of its lines."""

    lines: Lines
    planes: Float64[Array, "p 3 3"]
    """(p, 3, 3) covariances."""
    rounding: Float64[Array, "n 4 4"]
    """(n, 4, 4) of each line: how far the edge that photos show may lie from where planes meet."""


@dataclass(frozen=True, eq=False)
class _Pairs:
    """k pairs of a line of the scan and a line of one photo."""

    first: Int64[Array, "k"]
    """(k,) lines of the scan."""
    second: Int64[Array, "k"]
    """(k,) lines of the photo."""
    values: Float64[Array, "k 2"]
    """(k, 2) z."""
    own: Float64[Array, "k 2 2"]
    """(k, 2, 2) covariance of z that comes from the edges."""
    by_line: Float64[Array, "k 2 4"]
    """(k, 2, 4) derivatives by what rounding does to the scan's line, (a1, a2, b1, b2)."""
    by_planes: Float64[Array, "k 2 6"]
    """(k, 2, 6) derivatives by the two parent planes."""
    by_mount: Float64[Array, "k 2 6"]
    """(k, 2, 6)."""

    def __getitem__(self, which: Array) -> "_Pairs":
        return _Pairs(
            self.first[which],
            self.second[which],
            self.values[which],
            self.own[which],
            self.by_line[which],
            self.by_planes[which],
            self.by_mount[which],
        )


def check_mounts(
    cloud: Lines,
    plane_covariances: Float64[Array, "p 3 3"],
    parts: Sequence[ProjectedEdges],
    mounts: Sequence[Matrix6],
    options: MergeOptions,
) -> MountTest:
    """Test whether the photos of a station show the lines of its scan where the stated mounts let expect them.

    Parameters
    ----------
    cloud
        Lines of the scan; those where two planes meet are compared.
    plane_covariances
        (p, 3, 3) of the planes that `Lines.parents` counts, (a1, a2, b).
    parts
        Lines of each photo.
    mounts
        (6, 6) covariance of each photo's mount.
    options
        How far lines may be from each other.
    """
    rounding = rounding_covariances(cloud.lengths, cloud.extents.mean(axis=1), options.rounding_std_m)
    scan = _Scan(cloud, plane_covariances, rounding)
    edges = np.flatnonzero((cloud.parents >= 0).all(axis=1))
    found = [
        _supported(_near(cloud, edges, part, options), scan, np.asarray(mount))
        for part, mount in zip(parts, mounts, strict=True)
    ]
    q = len(parts)
    each = [_estimate([pairs], scan, [mount]) for pairs, mount in zip(found, mounts, strict=True)]
    all_together = _estimate(found, scan, mounts)
    return MountTest(
        statistic=all_together.statistic,
        degrees_of_freedom=all_together.degrees,
        critical=_limit(all_together.degrees),
        variance_factor=all_together.variance_factor,
        pair_counts=np.array([len(pairs.first) for pairs in found], dtype=np.int64),
        statistics=np.array([one.statistic for one in each], dtype=np.float64),
        degrees_of_freedom_each=np.array([one.degrees for one in each], dtype=np.int64),
        criticals=np.array([_limit(one.degrees) for one in each], dtype=np.float64),
        mount_errors=np.array([one.error for one in each], dtype=np.float64).reshape(q, 6),
        error_covariances=np.array([one.covariance for one in each], dtype=np.float64).reshape(q, 6, 6),
    )


def _limit(degrees: int) -> float:
    return float(chi2_ppf(1.0 - ALPHA, degrees)) if degrees else 0.0


def _near(cloud: Lines, edges: Int64[Array, "e"], part: ProjectedEdges, options: MergeOptions) -> _Pairs:
    """Collect the pairs that could be one line if the mount were as wrong as `LOOSE_STD` says."""
    lines = part.lines
    moved = part.mount_jacobians[:, 2:] * LOOSE_STD
    reach = options.max_distance_m + np.sqrt(np.einsum("nij,nij->n", moved, moved))
    near = near_pairs(cloud[edges], lines, options.max_angle_gon * GON, reach, options.min_overlap)
    i, j = edges[near.first], near.second
    across = across_surfaces(part.surface_covariances, 0.5 * lines.lengths)[j]
    select = across @ np.linalg.inv(near.jacobians)
    by_edge = across @ (lines.covariances - part.surface_covariances)[j] @ np.swapaxes(across, 1, 2)
    return _Pairs(
        i,
        j,
        np.einsum("nij,nj->ni", select, near.differences),
        by_edge,
        select,
        -select @ cloud.parent_jacobians[i],
        across @ part.mount_jacobians[j],
    )


def _alone(pairs: _Pairs, scan: _Scan) -> Float64[Array, "k 2 2"]:
    """Give the covariance (k, 2, 2) of each z by itself, without the mount's part."""
    total = pairs.own + pairs.by_line @ scan.rounding[pairs.first] @ np.swapaxes(pairs.by_line, 1, 2)
    for slot in range(2):
        derivatives = pairs.by_planes[:, :, 3 * slot : 3 * slot + 3]
        planes = scan.planes[scan.lines.parents[pairs.first, slot]]
        total += derivatives @ planes @ np.swapaxes(derivatives, 1, 2)
    return np.asarray(total)


def _supported(pairs: _Pairs, scan: _Scan, mount: Matrix6) -> _Pairs:
    """Find the error of the mount that most pairs support; keep the pairs that fit it, one for each photo line."""
    if len(pairs.first) == 0:
        return pairs
    search = _Search(pairs, np.linalg.inv(_alone(pairs, scan)))
    loose = np.diag(LOOSE_STD**2)
    wrong, wrong_cost = search.best(np.linalg.inv(loose + mount))
    stated, stated_cost = search.best(np.linalg.inv(EXACT * loose + mount))
    squares = search.misfits(wrong if stated_cost - wrong_cost > MIN_GAIN else stated)
    kept = np.flatnonzero(_is_best(pairs, squares) & (squares <= OUTLIER))
    return pairs[kept if len(kept) >= MIN_PAIRS else kept[:0]]


@dataclass(frozen=True, eq=False)
class _Search:
    """Search for the mount's error that most pairs support.

    The measure is the sum over the photo's lines of min(T, limit), T of the best fitting partner, plus the squared
    error in units of its prior.
    """

    pairs: _Pairs
    weights: Float64[Array, "k 2 2"]

    def best(self, prior: Matrix6) -> tuple[Float64[Array, "6"], float]:
        """Give the best error and its measure; `prior` is a weight matrix."""
        hypotheses = [np.zeros(6)]
        certain = np.argsort(-np.linalg.norm(self.weights, axis=(1, 2)), kind="stable")[:SEEDS].tolist()
        for some in [*((k,) for k in certain), *combinations(certain, 2)]:
            shares = np.zeros(len(self.weights))
            shares[list(some)] = 1.0
            hypotheses.append(self._fitted(shares, prior))
        costs = [self._measure(error, prior) for error in hypotheses]
        cost, error = min(costs), hypotheses[int(np.argmin(costs))]
        for _ in range(ROUNDS):
            squares = self.misfits(error)
            shares = np.where(_is_best(self.pairs, squares), 1.0 / (1.0 + squares / OUTLIER) ** 2, 0.0)
            refined = self._fitted(shares, prior)
            refined_cost = self._measure(refined, prior)
            if refined_cost > cost:
                break
            cost, error = refined_cost, refined
        return error, cost

    def misfits(self, error: Float64[Array, "6"]) -> Float64[Array, "k"]:
        """Give T of each pair with the mount corrected by an error."""
        left = self.pairs.values - self.pairs.by_mount @ error
        return np.asarray(np.einsum("ni,nij,nj->n", left, self.weights, left))

    def _measure(self, error: Float64[Array, "6"], prior: Matrix6) -> float:
        best = np.full(int(self.pairs.second.max()) + 1, OUTLIER)
        np.minimum.at(best, self.pairs.second, self.misfits(error))
        return float(best.sum() + error @ prior @ error)

    def _fitted(self, shares: Float64[Array, "k"], prior: Matrix6) -> Float64[Array, "6"]:
        weighted = shares[:, None, None] * np.swapaxes(self.pairs.by_mount, 1, 2) @ self.weights
        right = np.einsum("nij,nj->i", weighted, self.pairs.values)
        return np.asarray(np.linalg.solve((weighted @ self.pairs.by_mount).sum(axis=0) + prior, right))


def _is_best(pairs: _Pairs, squares: Float64[Array, "k"]) -> Array:
    """Tell which pairs fit best of all pairs of their photo line."""
    order = np.lexsort((squares, pairs.second))
    is_best = np.zeros(len(squares), dtype=bool)
    is_best[order[np.unique(pairs.second[order], return_index=True)[1]]] = True
    return is_best


@dataclass(frozen=True, eq=False)
class _Estimate:
    statistic: float
    degrees: int
    variance_factor: float
    error: Float64[Array, "six_q"]
    covariance: Float64[Array, "six_q six_q"]


def _estimate(found: Sequence[_Pairs], scan: _Scan, mounts: Sequence[Matrix6]) -> _Estimate:
    """Estimate the mounts' errors from all pairs together, and test whether they are as small as stated."""
    loose = np.tile(LOOSE_STD, len(found))
    if sum(len(pairs.first) for pairs in found) == 0:
        return _Estimate(0.0, 0, 1.0, np.zeros(len(loose)), np.diag(loose**2))
    values = np.concatenate([pairs.values.ravel() for pairs in found])
    by_mounts = block_diag(*(pairs.by_mount.reshape(-1, 6) for pairs in found)) * loose
    covariance = _joint_covariance(found, scan)
    solved = np.linalg.solve(covariance, np.column_stack([values, by_mounts]))
    eigenvalues, vectors = np.linalg.eigh(by_mounts.T @ solved[:, 1:])
    determined = eigenvalues > 1.0
    values_of, axes = eigenvalues[determined], vectors[:, determined]
    estimate = axes.T @ (by_mounts.T @ solved[:, 0]) / values_of
    omega = float(values @ solved[:, 0] - values_of @ estimate**2)
    redundancy = len(values) - len(estimate)
    factor = 1.0
    if redundancy > 0 and omega > chi2_ppf(0.99, redundancy):
        factor = omega / redundancy
    stated = block_diag(*mounts) / np.outer(loose, loose)
    spread = np.diag(factor / values_of) + axes.T @ stated @ axes
    statistic = float(estimate @ np.linalg.solve(spread, estimate)) if len(estimate) else 0.0
    open_axes = vectors[:, ~determined]
    uncertain = (axes * (factor / values_of)) @ axes.T + open_axes @ open_axes.T
    return _Estimate(statistic, len(estimate), factor, loose * (axes @ estimate), uncertain * np.outer(loose, loose))


def _joint_covariance(found: Sequence[_Pairs], scan: _Scan) -> Array:
    """Give the covariance of all z together, without the mounts' parts: edges, and shared lines and planes."""
    own = block_diag(*(block for pairs in found for block in pairs.own))
    first = np.concatenate([pairs.first for pairs in found])
    lines, at_lines = np.unique(first, return_inverse=True)
    by_line = _spread(np.concatenate([pairs.by_line for pairs in found]), at_lines, len(lines))
    planes, at_planes = np.unique(scan.lines.parents[first], return_inverse=True)
    at_planes = at_planes.reshape(-1, 2)
    by_planes = np.concatenate([pairs.by_planes for pairs in found])
    by_plane = sum(
        _spread(by_planes[:, :, 3 * slot : 3 * slot + 3], at_planes[:, slot], len(planes)) for slot in range(2)
    )
    return np.asarray(
        own
        + by_line @ block_diag(*scan.rounding[lines]) @ by_line.T
        + by_plane @ block_diag(*scan.planes[planes]) @ np.transpose(by_plane)
    )


def _spread(blocks: Float64[Array, "k 2 s"], places: Int64[Array, "k"], count: int) -> Float64[Array, "rows columns"]:
    """Lay the blocks of k pairs of rows into the columns of what they depend on; `places` counts to `count`."""
    k, rows, size = blocks.shape
    laid = np.zeros((k, rows, count, size))
    laid[np.arange(k), :, places] = blocks
    return laid.reshape(rows * k, -1)
