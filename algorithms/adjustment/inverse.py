"""The inverse of normal equations, element by element where it is asked for (MATH 3.1).

Of thousands of stations the whole inverse would not fit into memory, and hardly anyone reads it: tests of a feature
need the cofactors of the stations that see it, a pose those of its own.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from jaxtyping import Float64, Int64
from scipy import linalg, sparse

from algorithms.arrays import Array, Matrix

if TYPE_CHECKING:
    from algorithms.adjustment.hybrid.sparse_factor import SymmetricFactor

MOST_DENSE = 300
"""Up to so many unknowns dense matrices are some ten times faster than sparse ones, whose overhead is fixed."""

COLUMNS_AT_ONCE = 120
"""Whole columns of the inverse that are held in memory together."""

BlockColumns: TypeAlias = Int64[Array, "n s"]
Blocks: TypeAlias = Float64[Array, "n s s"]
NormalMatrix: TypeAlias = "sparse.csc_array | Array"


class Inverse(ABC):
    """Q, the inverse of a symmetric positive definite matrix of u unknowns (MATH 3.1)."""

    @abstractmethod
    def blocks(self, columns: BlockColumns) -> Blocks:
        """Give the elements of Q between the unknowns of each row of (n, s)."""

    @abstractmethod
    def times(self, right: Array) -> Array:
        """Give Q b for b (u,) or (u, k)."""

    @abstractmethod
    def whole(self) -> Matrix:
        """Give all of Q, (u, u)."""


@dataclass(frozen=True, eq=False)
class DenseInverse(Inverse):
    """All of Q (MATH 3.1)."""

    matrix: Array
    """(u, u)."""

    def blocks(self, columns: BlockColumns) -> Blocks:
        """Cut the elements out."""
        return np.asarray(self.matrix[columns[:, :, None], columns[:, None, :]])

    def times(self, right: Array) -> Array:
        """Multiply."""
        return np.asarray(self.matrix @ right)

    def whole(self) -> Matrix:
        """Give the matrix."""
        return self.matrix


@dataclass(frozen=True, eq=False)
class SparseInverse(Inverse):
    """Q by a sparse factor: the elements where the factor has some at once, others by whole columns (MATH 3.1)."""

    factor: "SymmetricFactor"

    def blocks(self, columns: BlockColumns) -> Blocks:
        """Look the elements up, and solve for the columns of blocks that have others."""
        shape = (*columns.shape, columns.shape[1])
        first = np.ascontiguousarray(np.broadcast_to(columns[:, :, None], shape))
        second = np.ascontiguousarray(np.broadcast_to(columns[:, None, :], shape))
        found = self.factor.elements(first, second)
        elsewhere = np.flatnonzero(np.isnan(found).any(axis=(1, 2)))
        # blocks one after the other, as many as have few columns together
        while len(elsewhere):
            count = max(1, COLUMNS_AT_ONCE // columns.shape[1])
            now, elsewhere = elsewhere[:count], elsewhere[count:]
            unknowns, at = np.unique(columns[now], return_inverse=True)
            solved = self._columns(unknowns)
            found[now] = solved[columns[now][:, :, None], at.reshape(len(now), 1, -1)]
        return np.asarray(0.5 * (found + np.swapaxes(found, 1, 2)))

    def times(self, right: Array) -> Array:
        """Solve."""
        return self.factor.solved(right)

    def whole(self) -> Matrix:
        """Solve for every column. O(u) times the elements of the factor."""
        inverse = self._columns(np.arange(len(self.factor.scale)))
        return np.asarray(0.5 * (inverse + inverse.T))

    def _columns(self, unknowns: Array) -> Array:
        unit = np.zeros((len(self.factor.scale), len(unknowns)))
        unit[unknowns, np.arange(len(unknowns))] = 1.0
        return self.factor.solved(unit)


@dataclass(frozen=True, eq=False)
class EnlargedInverse(Inverse):
    """Q + G S Gᵀ: what further unknowns with the covariance S, to which these answer by G, add (MATH 3.1)."""

    inner: Inverse
    by_others: Array
    """(u, c) G."""
    covariance: Array
    """(c, c) S."""

    def blocks(self, columns: BlockColumns) -> Blocks:
        """Enlarge the elements."""
        answers = self.by_others[columns]
        return np.asarray(self.inner.blocks(columns) + answers @ self.covariance @ np.swapaxes(answers, 1, 2))

    def times(self, right: Array) -> Array:
        """Multiply by both parts."""
        return np.asarray(self.inner.times(right) + self.by_others @ (self.covariance @ (self.by_others.T @ right)))

    def whole(self) -> Matrix:
        """Add the matrices."""
        return np.asarray(self.inner.whole() + self.by_others @ self.covariance @ self.by_others.T)


@dataclass(frozen=True, eq=False)
class Information:
    """A symmetric positive definite matrix of normal equations, dense for few unknowns, sparse for many (MATH 3.1)."""

    matrix: NormalMatrix
    """(u, u)."""

    @cached_property
    def dense(self) -> Matrix:
        """(u, u) zeros written out."""
        return self.matrix if isinstance(self.matrix, np.ndarray) else np.asarray(self.matrix.toarray())

    def times(self, right: Array) -> Array:
        """Give N x for x (u,) or (u, k)."""
        return np.asarray(self.matrix @ right)

    def scaled(self, factor: float) -> "Information":
        """Multiply it by a factor."""
        return Information(factor * self.matrix)

    def mixed(self, share: float, other: "Information", other_share: float) -> "Information":
        """Give the weighted sum of two, of which the other one may know the first unknowns only."""
        u, known = self.matrix.shape[0], other.matrix.shape[0]
        if u <= MOST_DENSE:
            total = share * self.dense
            total[:known, :known] += other_share * other.dense
            return Information(total)
        added = sparse.coo_array(sparse.csc_array(other.matrix))
        padded = sparse.coo_array((other_share * added.data, added.coords), shape=(u, u))
        return Information(sparse.csc_array(share * sparse.csc_array(self.matrix) + sparse.csc_array(padded)))

    def inverse(self) -> Inverse:
        """Factorise it, scaled to a unit diagonal.

        Raises
        ------
        LinAlgError
            When it is not positive definite.
        """
        if self.matrix.shape[0] <= MOST_DENSE:
            scale = 1.0 / np.sqrt(np.diag(self.dense))
            factor = linalg.cho_factor(scale[:, None] * self.dense * scale)
            unscaled = linalg.cho_solve(factor, np.diag(scale)) * scale[:, None]
            return DenseInverse(np.asarray(0.5 * (unscaled + unscaled.T)))
        from algorithms.adjustment.hybrid.sparse_factor import Elimination, SymmetricFactor  # loads compiled loops

        matrix = sparse.csc_array(self.matrix)
        sparse_factor = SymmetricFactor.of_matrix(matrix, Elimination.of_pattern(matrix), least=0.0)
        if sparse_factor.helped.any():
            raise np.linalg.LinAlgError("the matrix is not positive definite")
        return SparseInverse(sparse_factor)
