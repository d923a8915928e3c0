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


class GrossErrorSearch:
    """Hypotheses about one solution (MATH 4.4, 4.5; Baarda 1968). O(m²) with shared planes, else O(m u).

    Parameters
    ----------
    solution
        Of an adjustment.
    variance_factor
        Its covariances are multiplied by this in tests.
    """

    def __init__(self, solution: Solution, variance_factor: float = 1.0) -> None:
        self._solution, self._variance_factor = solution, variance_factor
        whitening, system = solution.whitening, solution.system
        self._weighted = whitening.apply_transposed(whitening.apply(system.residuals))  # P v
        self._by_unknowns = whitening.apply_transposed(whitening.apply(system.dense_jacobian))  # P J
        self._taken_out = np.zeros((0, len(system.residuals)))
        self._block_of_row = system.block_of_row
        self._block_count = sum(n for n, _ in system.shapes)
        self._block_covariances = self._covariances_of_blocks()
        self._planes = self._shared(self._distinct_planes(), 3)
        self._photos = self._shared(self._several_of_photos(), 6)

    @property
    def global_statistic(self) -> tuple[float, int]:
        """Omega and the redundancy of the solution (MATH 4.1)."""
        return self._solution.omega, self._solution.redundancy

    def tests(self) -> GrossErrorTests:
        """Test every correspondence by itself, every plane that several depend on, and the mount of every photo."""
        count = self._block_count
        statistics, degrees = np.concatenate(
            [self._of_blocks(), self._planes.tested(self._weighted), self._photos.tested(self._weighted)], axis=1
        )
        statistics = statistics / self._variance_factor
        return GrossErrorTests(
            statistics,
            degrees,
            log_probability(statistics, degrees),
            (*np.arange(count, dtype=np.int64)[:, None], *self._planes.members, *self._photos.members),
            (*[None] * count, *self._planes.which, *[None] * len(self._photos.which)),
            (*[None] * (count + len(self._planes.which)), *self._photos.which),
        )

    def take_out(self, hypothesis: int) -> None:
        """Give the errors of a correspondence or plane unknowns of their own: `tests` are then of all others beside it.

        As an adjustment without it would, as long as that moves the pose too little for another linearisation. With G
        of the hypothesis, P Qvv P and P v lose what G explains (MATH 4.5). O(m (m + t)) with t errors out, m residuals.

        Parameters
        ----------
        hypothesis
            Number in `tests()`.
        """
        if hypothesis < self._block_count:
            rows = np.flatnonzero(self._block_of_row == hypothesis)
            crossed, u, scales = self._crossed_of_rows(rows), self._weighted[rows], self._diagonal_weights[rows]
            own = crossed[:, rows]
        else:
            k = hypothesis - self._block_count
            design, own, scales = self._planes.designs[k], self._planes.own[k], self._planes.weights[k]
            crossed, u = self._crossed(design), design @ self._weighted
        root = _whitened(own[None], scales[None])[0]
        explained = root @ crossed
        self._weighted = self._weighted - explained.T @ (root @ u)
        self._taken_out = np.vstack([self._taken_out, explained])
        parts = self._solution.system.split(explained.T)
        self._block_covariances = [
            mine - part @ np.swapaxes(part, 1, 2) for mine, part in zip(self._block_covariances, parts, strict=True)
        ]
        self._planes, self._photos = self._planes.without(explained), self._photos.without(explained)

    def of_mount(self, hypothesis: int) -> tuple[Array, Array]:
        """Give u (6,) and its covariance N (6, 6) of the hypothesis that a mount is wrong (MATH 4.4).

        Parameters
        ----------
        hypothesis
            Number in `tests()`, of a mount. Its errors count in units of the root of the mount's covariance.
        """
        k = hypothesis - self._block_count - len(self._planes.which)
        return self._photos.designs[k] @ self._weighted, self._photos.own[k]

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
        return self._inseparable_planes(hypothesis - self._block_count)

    def _inseparable_blocks(self, block: int) -> tuple[Partner, ...]:
        rows = np.flatnonzero(self._block_of_row == block)
        crossed = self._crossed_of_rows(rows)
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

    def _inseparable_planes(self, plane: int) -> tuple[Partner, ...]:
        planes = self._planes
        crossed = self._crossed(planes.designs[plane])
        mine = _whitened(planes.own[plane][None], planes.weights[plane][None])[0]
        blocks, correlations = [], []
        for k, members in enumerate(planes.members):
            if np.intersect1d(planes.members[plane], members).size:
                continue
            root = _whitened(planes.own[k][None], planes.weights[k][None])[0]
            correlations.append(float(np.linalg.norm(mine @ crossed @ planes.designs[k].T @ root.T, ord=2)))
            blocks.append(int(members[-1]))  # the pair of planes itself comes after the lines in it
        return _partners(blocks, correlations)

    @cached_property
    def _diagonal_weights(self) -> Scalars:
        return self._solution.whitening.weight_diagonal()

    def _crossed_of_rows(self, rows: Indices) -> Array:
        """Give rows of P Qvv P beside what is taken out."""
        matrix = self._solution.whitening.matrix
        if isinstance(matrix, np.ndarray):
            chosen = matrix[:, rows].T @ matrix
        else:
            columns = sparse.csc_array(matrix)
            chosen = np.asarray((columns[:, rows].T @ columns).toarray())
        return np.asarray(
            chosen
            - self._by_unknowns[rows] @ self._solution.cofactors @ self._by_unknowns.T
            - self._taken_out[:, rows].T @ self._taken_out
        )

    def _crossed(self, design: Array) -> Array:
        """Give Gᵀ P Qvv P beside what is taken out for Gᵀ (s, m) of a plane."""
        by_unknowns = design @ self._by_unknowns @ self._solution.cofactors @ self._by_unknowns.T
        whitening = self._solution.whitening
        weighted = whitening.apply_transposed(whitening.apply(design.T)).T
        return np.asarray(weighted - by_unknowns - (design @ self._taken_out.T) @ self._taken_out)

    def _covariances_of_blocks(self) -> list[Array]:
        """Give (P Qvv P) of each block, (n, d, d) for each type: the covariance of u."""
        system, cofactors, first, found = self._solution.system, self._solution.cofactors, 0, []
        matrix = self._solution.whitening.matrix
        for blocks, by_unknowns in zip(system.covariances, system.split(self._by_unknowns), strict=True):
            n, d = blocks.shape[:2]
            if isinstance(matrix, np.ndarray):
                columns = matrix[:, first : first + n * d].T.reshape(n, d, len(matrix))
                weights = columns @ np.swapaxes(columns, 1, 2)
            else:
                weights = np.linalg.inv(blocks)
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

    def _distinct_planes(self) -> list["_Objects"]:
        """Find the planes that several correspondences depend on.

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
            found.append(_Objects(station, derivatives, members, new))
        return found

    def _several_of_photos(self) -> list["_Objects"]:
        """Find the photos that several correspondences depend on; errors in units of the roots of their covariances."""
        found = []
        for station, factor in self._solution.system.photo_factors.items():
            members = self._dependents_of(factor, 6)
            several = np.flatnonzero(members.sum(axis=1) >= FEWEST_OF_PLANE).tolist()
            found.append(_Objects(station, factor, members, several))
        return found

    def _shared(self, objects: "list[_Objects]", size: int) -> "_SharedHypotheses":
        """Prepare the hypotheses about objects of `size` errors that correspondences share."""
        m = len(self._weighted)
        which: list[tuple[int, int]] = []
        members: list[Array] = []
        designs = [np.zeros((0, size, m))]
        for each in objects:
            columns = (size * np.array(each.chosen, dtype=np.int64)[:, None] + np.arange(size)).ravel()
            designs.append(each.derivatives.tocsc()[:, columns].toarray().T.reshape(len(each.chosen), size, m))
            which += [(each.station, k) for k in each.chosen]
            members += [np.flatnonzero(each.members[k]) for k in each.chosen]
        together = np.concatenate(designs)
        if not which:
            return _SharedHypotheses(which, members, together, np.zeros((0, size, size)), np.zeros((0, size)))
        whitening = self._solution.whitening
        whitened = whitening.apply(together.reshape(-1, m).T).T.reshape(len(which), size, whitening.rank)
        weights = whitened @ np.swapaxes(whitened, 1, 2)
        by_unknowns = together @ self._by_unknowns
        own = weights - by_unknowns @ self._solution.cofactors @ np.swapaxes(by_unknowns, 1, 2)
        return _SharedHypotheses(which, members, together, own, np.diagonal(weights, axis1=1, axis2=2))

    def _dependents_of(self, derivatives: sparse.csr_array, size: int) -> Array:
        """Give (p, blocks) which correspondences depend on each of p objects with `size` errors."""
        entries = sparse.coo_array(derivatives)
        members = np.zeros((derivatives.shape[1] // size, self._block_count), dtype=bool)
        members[entries.coords[1] // size, self._block_of_row[entries.coords[0]]] = True
        return members


@dataclass(frozen=True, eq=False)
class _Objects:
    """A station's p planes or photos with s errors each."""

    station: int
    derivatives: sparse.csr_array
    """(m, p s) of all residuals by their errors."""
    members: Array
    """(p, blocks) which correspondences depend on each."""
    chosen: list[int]
    """Numbers of those that are asked about."""


@dataclass(frozen=True, eq=False)
class _SharedHypotheses:
    """The k planes or photos with s errors each, and what the tests need of them."""

    which: list[tuple[int, int]]
    """Station and number."""
    members: list[Array]
    """Correspondences that depend on each."""
    designs: Array
    """(k, s, m) Gᵀ."""
    own: Array
    """(k, s, s) N, the covariances of u."""
    weights: Array
    """(k, s) diagonals of Gᵀ P G, to which control is relative."""

    def tested(self, weighted: Array) -> Array:
        """Give T and degrees of freedom of each from P v (m,), (2, k)."""
        return quadratic_forms(self.own, self.designs @ weighted, self.weights)

    def without(self, explained: Array) -> "_SharedHypotheses":
        """Take from the covariances what (s, m) other errors explain."""
        part = self.designs @ explained.T
        return replace(self, own=self.own - part @ np.swapaxes(part, 1, 2))


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
