"""Weights of correlated and possibly dependent residuals: what makes them independent with unit variance (MATH 3.3)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from scipy import linalg, sparse

from algorithms.adjustment.problem import LinearSystem
from algorithms.arrays import Array
from algorithms.errors import InvalidInputError

DEPENDENT_PER_TILT_VARIANCE = 20.0
SMALLEST_DEPENDENT_SHARE, LARGEST_DEPENDENT_SHARE = 1e-8, 0.05
"""Limits of the variance share below which a combination of residuals is left out: 20 times the largest tilt variance.

Lines of shared planes are bound to each other by conditions that hold exactly for error-free planes. Both scans'
planes are noisy, so the conditions of the two sides differ by the tilt errors. That gives such combinations a
variance, relative to the blocks' own, of 1 to 5 times the tilt variance (measured over rooms with tilts of 1e-4 to
2e-2), which means nothing: weighting by it would pretend information. Real combinations have shares near 1. Leaving a
combination out is always honest; it only spends what little the combination could tell."""

LEFT_OUT_SHARE = 1e-4
"""What is left out before eigenvalues are looked for, as a share of that limit: it changed weights by up to 6e-6 and
normal equations by up to 1e-7 of themselves (garage, yard, flat, pipe hall)."""

Rows: TypeAlias = "sparse.csr_array | Array"


@dataclass(frozen=True, eq=False)
class Whitening:
    """A matrix F with F C Fᵀ = I, so that P = Fᵀ F is the weight matrix, a generalised inverse of C (MATH 3.3)."""

    matrix: Rows
    """(rank, m) F; sparse when the blocks are independent."""

    @property
    def rank(self) -> int:
        """Number of independent conditions."""
        return int(self.matrix.shape[0])

    def apply(self, stacked: Array) -> Array:
        """Give F x for x of shape (m,) or (m, k)."""
        return np.asarray(self.matrix @ stacked)

    def apply_transposed(self, whitened: Array) -> Array:
        """Give Fᵀ y for y of shape (rank,) or (rank, k)."""
        return np.asarray(self.matrix.T @ whitened)

    def weight_diagonal(self) -> Array:
        """Give the diagonal of P, (m,)."""
        if isinstance(self.matrix, np.ndarray):
            return np.asarray((self.matrix**2).sum(axis=0))
        return np.asarray(self.matrix.power(2).sum(axis=0)).ravel()

    def projector_diagonal(self, system: LinearSystem) -> Array:
        """Give the diagonal of C P, (m,): ones where every combination of the residuals is used."""
        if system.joint_covariance is None or not isinstance(self.matrix, np.ndarray):
            return np.ones(len(system.residuals))
        return np.asarray(np.einsum("ij,ji->i", system.joint_covariance @ self.matrix.T, self.matrix))


def whitening_of(system: LinearSystem) -> Whitening:
    """Build the whitening of a system's residuals (MATH 3.3).

    Raises
    ------
    InvalidInputError
        When the covariance of a block by itself is not positive definite.
    """
    roots = [_inverse_roots(blocks) for blocks in system.covariances]
    if system.joint_covariance is None:
        return Whitening(_blockwise(roots))
    # In units of each block the diagonal blocks are unit matrices, so one threshold fits tilts and offsets.
    normalised = _times(roots, _times(roots, system.joint_covariance).T)
    limit = _dependent_share(system)
    factor = _thin_factor(0.5 * (normalised + normalised.T), LEFT_OUT_SHARE * limit)
    # L w / sqrt(value) is an eigenvector of L Lᵀ where w is one of the smaller Lᵀ L
    values, vectors = _eigen(factor.T @ factor)
    kept = values > limit
    transposed = [np.swapaxes(blocks, 1, 2) for blocks in roots]
    return Whitening(_times(transposed, factor @ (vectors[:, kept] / values[kept])).T)


def _thin_factor(symmetric: Array, tolerance: float) -> Array:
    """Give L (m, r) with L Lᵀ a positive semidefinite matrix but for variances below the tolerance. O(m r²).

    About half of the combinations of lines and planes are bound to the others, and cost nothing so.
    """
    factor, pivots, rank, _ = linalg.lapack.dpstrf(symmetric, tol=tolerance, lower=1)
    found = np.empty((len(symmetric), rank))
    found[pivots - 1] = np.tril(factor)[:, :rank]
    return found


def _eigen(symmetric: Array) -> tuple[Array, Array]:
    """Give eigenvalues and eigenvectors; the fast divide-and-conquer driver fails on rare clustered spectra."""
    try:
        values, vectors = linalg.eigh(symmetric, driver="evd")
    except np.linalg.LinAlgError:
        values, vectors = linalg.eigh(symmetric, driver="ev")
    return values, vectors


def _dependent_share(system: LinearSystem) -> float:
    """Give the variance share below which a combination of residuals counts as bound; tilts come first in a block."""
    diagonals = [np.diagonal(blocks, axis1=1, axis2=2)[:, :2] for blocks in system.covariances]
    tilts = max(float(diagonal.max(initial=0.0)) for diagonal in diagonals)
    return float(np.clip(DEPENDENT_PER_TILT_VARIANCE * tilts, SMALLEST_DEPENDENT_SHARE, LARGEST_DEPENDENT_SHARE))


def _inverse_roots(blocks: Array) -> Array:
    """Give the inverse Cholesky factors of (n, d, d) covariances."""
    # Scaling to correlations first: tilts [rad] and offsets [m] may differ by many powers of ten.
    std = np.sqrt(np.maximum(np.diagonal(blocks, axis1=1, axis2=2), 0.0))
    if not np.isfinite(blocks).all() or (std <= 0.0).any():
        raise InvalidInputError("covariance of a feature", "variances must be positive and finite")
    try:
        roots = np.linalg.cholesky(blocks / (std[:, :, None] * std[:, None, :]))
    except np.linalg.LinAlgError as error:
        raise InvalidInputError("covariance of a feature", "it is not positive definite") from error
    return np.asarray(np.linalg.inv(roots) / std[:, None, :])


def _blockwise(roots: Sequence[Array]) -> sparse.csr_array:
    """Lay (n, d, d) blocks of all types on the diagonal of one sparse matrix."""
    parts = []
    for blocks in roots:
        n, d = blocks.shape[:2]
        parts.append(sparse.bsr_array((blocks, np.arange(n), np.arange(n + 1)), shape=(n * d, n * d)))
    return sparse.csr_array(sparse.block_diag(parts, format="csr"))


def _times(roots: Sequence[Array], matrix: Array) -> Array:
    """Multiply the blocks of all types on a diagonal by a dense matrix (m, k)."""
    parts, first = [], 0
    for blocks in roots:
        n, d = blocks.shape[:2]
        rows = matrix[first : first + n * d].reshape(n, d, matrix.shape[1])
        parts.append((blocks @ rows).reshape(n * d, matrix.shape[1]))
        first += n * d
    return np.concatenate(parts)
