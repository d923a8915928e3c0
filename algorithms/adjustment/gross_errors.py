"""What may be wrong: a correspondence, a plane or the mount of a camera with all that depends on it (MATH 4.4; Baarda).

A hypothesis adds its own unknowns to the adjustment, r = J x + G d + noise. How far the weighted sum of squared
residuals would drop, T = uᵀ N⁺ u with u = Gᵀ P v and N = Gᵀ P Qvv P G, is chi-square distributed with rank N degrees of
freedom while there is no error. For a single correspondence G selects its components; for a plane it holds the
derivatives of all residuals by the plane's errors: a door that was opened moves its plane and every edge of it at once,
and single tests would put the blame on neighbours. For the mount of a camera it holds the derivatives by its six
errors: a photo whose pose on the scanner is not what was stated moves all its lines.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from scipy import sparse, special

from algorithms.adjustment.solver import Solution
from algorithms.adjustment.testing import NOT_CONTROLLED
from algorithms.arrays import Array, Flags, Indices, Scalars

INSEPARABLE = 0.9
"""Above this correlation of two hypotheses' test values either could be the true one (MATH 4.5)."""

FEWEST_OF_PLANE = 2
"""A plane with a single dependent correspondence is that correspondence."""

SMALLEST_PROBABILITY = 1e-280
"""Below this the asymptotic series takes over."""

Plane: TypeAlias = tuple[int, int]
"""Station and number of a plane."""

Photo: TypeAlias = tuple[int, int]
"""Station and number of a photo."""


@dataclass(frozen=True)
class Partner:
    """A correspondence that may be the wrong one instead."""

    block: int
    """Number of the correspondence."""
    correlation: float
    """Largest correlation between a combination of its residuals and one of the other's, 0..1."""


@dataclass(frozen=True, eq=False)
class GrossErrorTests:
    """Tests of all hypotheses: the n correspondences first, then planes, then mounts of photos (MATH 4.4)."""

    statistics: Scalars
    """(n,) T."""
    degrees: Scalars
    """(n,) degrees of freedom; 0 where the others do not control it."""
    log_p: Scalars
    """(n,) natural logarithm of the probability of a larger T without error."""
    blocks: tuple[Array, ...]
    """Correspondences that each hypothesis is about, in the numbering of the adjustment."""
    planes: tuple[Plane | None, ...]
    """The plane, or None for a single correspondence or a mount."""
    photos: tuple[Photo | None, ...]
    """The photo whose mount may be wrong, or None for a single correspondence or a plane."""

    def with_variance(self, factor: float) -> "GrossErrorTests":
        """Give the tests for covariances multiplied by a variance factor."""
        statistics = self.statistics / factor
        return replace(self, statistics=statistics, log_p=log_probability(statistics, self.degrees))


class GrossErrorSearch:
    """Hypotheses about one solution (MATH 4.4, 4.5; Baarda 1968). O(m²) with shared planes, else O(m u)."""

    def __init__(self, solution: Solution) -> None:
        self._solution = solution
        whitening, system = solution.whitening, solution.system
        self._weighted = whitening.apply_transposed(whitening.apply(system.residuals))  # P v
        self._by_unknowns = whitening.apply_transposed(whitening.apply(system.dense_jacobian))  # P J
        self._block_of_row = system.block_of_row
        self._block_count = sum(n for n, _ in system.shapes)

    @property
    def global_statistic(self) -> tuple[float, int]:
        """Omega and the redundancy of the solution (MATH 4.1)."""
        return self._solution.omega, self._solution.redundancy

    def tests(self) -> GrossErrorTests:
        """Test every correspondence by itself, every plane that several depend on, and the mount of every photo."""
        count = self._block_count
        single = [self._of_blocks()]
        blocks = list(np.arange(count, dtype=np.int64)[:, None])
        planes: list[Plane | None] = [None] * count
        for hypothesis in self._plane_hypotheses:
            planes.append(hypothesis.which)
            blocks.append(hypothesis.members)
            single.append(hypothesis.tested)
        photos: list[Photo | None] = [None] * len(planes)
        for hypothesis in self._photo_hypotheses:
            planes.append(None)
            photos.append(hypothesis.which)
            blocks.append(hypothesis.members)
            single.append(hypothesis.tested)
        statistics, degrees = np.concatenate(single, axis=1)
        log_p = log_probability(statistics, degrees)
        return GrossErrorTests(statistics, degrees, log_p, tuple(blocks), tuple(planes), tuple(photos))

    def of_mount(self, hypothesis: int) -> tuple[Array, Array]:
        """Give u (6,) and its covariance N (6, 6) of the hypothesis that a mount is wrong (MATH 4.4).

        Parameters
        ----------
        hypothesis
            Number in `tests()`, of a mount. Its errors count in units of the root of the mount's covariance.
        """
        photo = self._photo_hypotheses[hypothesis - self._block_count - len(self._plane_hypotheses)]
        return photo.design @ self._weighted, photo.own

    def inseparable(self, hypothesis: int) -> tuple[Partner, ...]:
        """Give what may be wrong instead: other hypotheses whose tests are correlated by more than 0.9 (MATH 4.5).

        The largest canonical correlation of u_i and u_j, with covariance Gᵀ P Qvv P G; for single observations it is
        |(Qvv)_ij| / sqrt(r_i r_j) in units of their standard deviations. Correspondences are compared with
        correspondences, planes with planes that no correspondence shares. The most correlated come first.

        Parameters
        ----------
        hypothesis
            Number in `tests()`.
        """
        if hypothesis < self._block_count:
            return self._inseparable_blocks(hypothesis)
        return self._inseparable_planes(self._plane_hypotheses[hypothesis - self._block_count])

    def _inseparable_blocks(self, block: int) -> tuple[Partner, ...]:
        rows = np.flatnonzero(self._block_of_row == block)
        crossed = self._weights_of(rows) - self._by_unknowns[rows] @ self._solution.cofactors @ self._by_unknowns.T
        mine = _whitened(crossed[:, rows][None], self._diagonal_weights[rows][None])[0]
        found, first = [], 0
        for own in self._block_covariances:
            n, d = own.shape[:2]
            crossings = crossed[:, first : first + n * d].reshape(len(rows), n, d).transpose(1, 0, 2)
            roots = _whitened(own, self._diagonal_weights[first : first + n * d].reshape(n, d))
            found.append(np.linalg.norm(mine @ crossings @ np.swapaxes(roots, 1, 2), ord=2, axis=(1, 2)))
            first += n * d
        together = np.concatenate(found)
        return _partners(
            [k for k in range(len(together)) if k != block], [float(r) for r in np.delete(together, block)]
        )

    def _inseparable_planes(self, plane: "_SharedHypothesis") -> tuple[Partner, ...]:
        crossed = plane.design @ self._weights
        by_unknowns = plane.design @ self._by_unknowns @ self._solution.cofactors @ self._by_unknowns.T
        mine = _whitened(plane.own[None], plane.weights[None])[0]
        blocks, correlations = [], []
        for other in self._plane_hypotheses:
            if np.intersect1d(plane.members, other.members).size:
                continue
            root = _whitened(other.own[None], other.weights[None])[0]
            correlations.append(float(np.linalg.norm(mine @ (crossed - by_unknowns) @ other.design.T @ root.T, ord=2)))
            blocks.append(int(other.members[-1]))  # the pair of planes itself comes after the lines in it
        return _partners(blocks, correlations)

    @cached_property
    def _weights(self) -> Array | None:
        """P, (m, m), where residuals are correlated."""
        if self._solution.system.joint_covariance is None:
            return None
        matrix = self._solution.whitening.matrix
        return np.asarray(matrix.T @ matrix)

    @cached_property
    def _diagonal_weights(self) -> Scalars:
        return self._solution.whitening.weight_diagonal()

    def _weights_of(self, rows: Indices) -> Array:
        """Give rows of P."""
        if self._weights is not None:
            return np.asarray(self._weights[rows])
        matrix = sparse.csc_array(self._solution.whitening.matrix)
        return np.asarray((matrix[:, rows].T @ matrix).toarray())

    @cached_property
    def _block_covariances(self) -> list[Array]:
        """(P Qvv P) of each block, (n, d, d) for each type: the covariance of u."""
        system, cofactors, first, found = self._solution.system, self._solution.cofactors, 0, []
        for blocks, by_unknowns in zip(system.covariances, system.split(self._by_unknowns), strict=True):
            n, d = blocks.shape[:2]
            if self._weights is None:
                weights = np.linalg.inv(blocks)
            else:
                places = first + np.arange(n * d).reshape(n, d)
                weights = self._weights[places[:, :, None], places[:, None, :]]
            found.append(weights - by_unknowns @ cofactors @ np.swapaxes(by_unknowns, 1, 2))
            first += n * d
        return found

    def _of_blocks(self) -> Array:
        """Give T and degrees of freedom of every correspondence, (2, n)."""
        system, parts = self._solution.system, []
        weights = system.split(self._diagonal_weights)
        for own, weighted, scale in zip(self._block_covariances, system.split(self._weighted), weights, strict=True):
            parts.append(quadratic_forms(own, weighted, scale))
        return np.concatenate(parts, axis=1)

    @cached_property
    def _plane_hypotheses(self) -> list["_SharedHypothesis"]:
        """Planes that several correspondences depend on.

        Of two planes with the same dependents (a matched pair) one stands for both: their derivatives span the same.
        """
        seen: set[bytes] = set()
        found = []
        for station, derivatives in self._solution.system.plane_jacobians.items():
            members = self._dependents_of(derivatives, 3)
            new = []
            for k in np.flatnonzero(members.sum(axis=1) >= FEWEST_OF_PLANE).tolist():
                if members[k].tobytes() not in seen:
                    seen.add(members[k].tobytes())
                    new.append(k)
            found += self._shared(station, derivatives, members, new)
        return found

    @cached_property
    def _photo_hypotheses(self) -> list["_SharedHypothesis"]:
        """Photos that several correspondences depend on, in units of the roots of their mounts' covariances."""
        found = []
        for station, factor in self._solution.system.photo_factors.items():
            members = self._dependents_of(factor, 6)
            several = np.flatnonzero(members.sum(axis=1) >= FEWEST_OF_PLANE).tolist()
            found += self._shared(station, factor, members, several)
        return found

    def _shared(
        self, station: int, derivatives: sparse.csr_array, members: Array, chosen: list[int]
    ) -> list["_SharedHypothesis"]:
        """Test the chosen ones of a station's p objects that correspondences share.

        Parameters
        ----------
        station
            Its number.
        derivatives
            (m, p s) of all residuals by the s errors of each object.
        members
            (p, blocks) which correspondences depend on each.
        chosen
            Numbers of objects.
        """
        if not chosen:
            return []
        size = derivatives.shape[1] // len(members)
        columns = (size * np.array(chosen)[:, None] + np.arange(size)).ravel()
        designs = derivatives.tocsc()[:, columns].toarray().T.reshape(len(chosen), size, -1)  # Gᵀ
        weighted_designs = (designs.reshape(len(columns), -1) @ self._weights).reshape(designs.shape)
        weights = np.einsum("kim,kjm->kij", weighted_designs, designs)
        by_unknowns = np.einsum("kim,mu->kiu", designs, self._by_unknowns)
        own = weights - by_unknowns @ self._solution.cofactors @ np.swapaxes(by_unknowns, 1, 2)
        scales = np.diagonal(weights, axis1=1, axis2=2)
        tested = quadratic_forms(own, designs @ self._weighted, scales)
        return [
            _SharedHypothesis(
                (station, k), np.flatnonzero(members[k]), designs[i], own[i], scales[i], tested[:, i : i + 1]
            )
            for i, k in enumerate(chosen)
        ]

    def _dependents_of(self, derivatives: sparse.csr_array, size: int) -> Array:
        """Give (p, blocks) which correspondences depend on each of p objects with `size` errors."""
        entries = sparse.coo_array(derivatives)
        members = np.zeros((derivatives.shape[1] // size, self._block_count), dtype=bool)
        members[entries.coords[1] // size, self._block_of_row[entries.coords[0]]] = True
        return members


@dataclass(frozen=True, eq=False)
class _SharedHypothesis:
    """A plane or photo with s errors, and what the tests need of it."""

    which: Plane | Photo
    members: Array
    """Correspondences that depend on it."""
    design: Array
    """(s, m) Gᵀ."""
    own: Array
    """(s, s) N, the covariance of u."""
    weights: Array
    """(s,) diagonal of Gᵀ P G, to which control is relative."""
    tested: Array
    """(2, 1) T and degrees of freedom."""


def _partners(blocks: list[int], correlations: list[float]) -> tuple[Partner, ...]:
    """Keep what is correlated too much, the most correlated first."""
    order = np.argsort([-correlation for correlation in correlations], kind="stable").tolist()
    return tuple(Partner(blocks[k], min(correlations[k], 1.0)) for k in order if correlations[k] > INSEPARABLE)


def log_probability(statistics: Scalars, degrees: Scalars) -> Scalars:
    """Give ln P(chi-square > T), also where the probability itself is too small for a number (MATH 4.4).

    Asymptotically Γ(a, x) = x^(a-1) e^-x (1 + (a-1)/x + (a-1)(a-2)/x² + ...), a = f/2, x = T/2 (Abramowitz and Stegun
    6.5.32); 0 where there is no degree of freedom.
    """
    half, x = np.maximum(degrees, 1.0) / 2.0, np.maximum(statistics, 0.0) / 2.0
    direct = special.gammaincc(half, x)
    far = direct < SMALLEST_PROBABILITY
    safe = np.where(far, x, 1.0)
    series, term = np.ones_like(x), np.ones_like(x)
    for k in range(1, 8):
        term = term * (half - k) / safe
        series = series + term
    series = np.where(far, series, 1.0)
    asymptotic = (half - 1.0) * np.log(safe) - safe - special.gammaln(half) + np.log(series)
    logs = np.where(far, asymptotic, np.log(np.where(far, 1.0, direct)))
    return np.where(degrees > 0, logs, 0.0)


def quadratic_forms(covariances: Array, vectors: Array, weights: Array) -> Array:
    """Give uᵀ N⁺ u and rank N of n hypotheses, (2, n); what is controlled less than 1e-5 of its weight is left out
    (MATH 4.4).
    """
    scale = 1.0 / np.sqrt(np.maximum(weights, np.finfo(np.float64).tiny))
    values, turned = np.linalg.eigh(covariances * scale[:, :, None] * scale[:, None, :])
    along = np.einsum("nij,ni->nj", turned, vectors * scale)
    seen: Flags = values > NOT_CONTROLLED
    statistics = (np.where(seen, along**2, 0.0) / np.where(seen, values, 1.0)).sum(axis=1)
    return np.stack([statistics, seen.sum(axis=1).astype(np.float64)])


def _whitened(covariances: Array, weights: Array) -> Array:
    """Give W with W N Wᵀ = I on the controlled part of n hypotheses, zero elsewhere."""
    scale = 1.0 / np.sqrt(np.maximum(weights, np.finfo(np.float64).tiny))
    values, turned = np.linalg.eigh(covariances * scale[:, :, None] * scale[:, None, :])
    seen = values > NOT_CONTROLLED
    inverse = np.where(seen, 1.0 / np.sqrt(np.where(seen, values, 1.0)), 0.0)
    return np.asarray(inverse[:, :, None] * np.swapaxes(turned, 1, 2) * scale[:, None, :])
