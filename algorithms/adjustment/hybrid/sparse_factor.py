"""The normal equations of a large network: ordered once, factorised, solved, and inverted where it matters."""

from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
import qdldl
from scipy import sparse
from scipy.sparse.linalg import spsolve_triangular

from algorithms.adjustment.hybrid.factor_kernels import (
    assemble,
    assembly_places,
    elimination_tree,
    factorise,
    inverse_elements,
    row_gains,
    row_products,
    row_squares,
    scale_to_unit_diagonal,
    selected_inverse,
    solve_in_place,
)
from algorithms.arrays import Array
from algorithms.errors import InvalidInputError

SMALLEST_PIVOT = 1e-11
"""A pivot of the normal equations, scaled to a unit diagonal, below this is zero up to rounding."""


@dataclass(frozen=True, eq=False)
class Elimination:
    """Order of elimination of a symmetric matrix, and where its factor has elements, for all of one pattern."""

    order: Array
    """(u,) unknown that is eliminated k-th."""
    places: Array
    """(u,) when an unknown is eliminated."""
    upper_starts: Array
    """(u + 1,) first element of each column of the permuted upper triangle of N."""
    upper_rows: Array
    """Rows of its elements, the diagonal last in each column."""
    parents: Array
    """(u,) elimination tree."""
    starts: Array
    """(u + 1,) first element of each column of L."""
    taken: Array
    """Which element of N, in the order of its columns, each element of the permuted upper triangle is."""
    ordered: tuple[Array, Array]
    """First element of each column of N, and its rows: what was ordered."""

    @staticmethod
    def of_pattern(pattern: sparse.csc_array) -> "Elimination":
        """Order by approximate minimum degree (Amestoy, Davis and Duff 1996), which qdldl brings (MATH 3.1).

        Parameters
        ----------
        pattern
            (u, u) symmetric matrix with elements, of whatever value, where N has some; the diagonal among them.
        """
        n = pattern.shape[1]
        ones = sparse.csc_array((np.ones(len(pattern.data)), pattern.indices, pattern.indptr), shape=(n, n))
        # any matrix of that pattern will do: a dominant diagonal makes all its pivots positive
        dominant = sparse.csc_array(ones + sparse.diags_array(np.asarray(ones.sum(axis=0)).ravel() + 1.0))
        order = np.asarray(qdldl.Solver(sparse.csc_matrix(dominant)).factors()[2], dtype=np.int64)
        places = np.empty(n, dtype=np.int64)
        places[order] = np.arange(n)
        at_rows, at_columns = places[pattern.indices], np.repeat(places, np.diff(pattern.indptr))
        kept = np.flatnonzero(at_rows <= at_columns)
        upper = sparse.csc_array(sparse.coo_array((kept, (at_rows[kept], at_columns[kept])), shape=(n, n)))
        upper.sort_indices()
        starts, rows, taken = upper.indptr.astype(np.int64), upper.indices.astype(np.int64), upper.data
        parents, counts = elimination_tree(n, starts, rows)
        lengths = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        ordered = (pattern.indptr.copy(), pattern.indices.copy())
        return Elimination(order, places, starts, rows, parents, lengths, taken, ordered)

    def has_pattern_of(self, matrix: sparse.csc_array) -> bool:
        """Say whether a matrix has elements where the ordered one has (MATH 3.1)."""
        starts, rows = self.ordered
        return np.array_equal(starts, matrix.indptr) and np.array_equal(rows, matrix.indices)


@dataclass(frozen=True, eq=False)
class Ordering(Elimination):
    """The same of the normal equations N = Aᵀ P A of derivatives A, and where they are assembled."""

    columns: Array
    """Columns of the elements of the ordered derivatives, row by row."""
    where: Array
    """Where the products of elements of one row are added in the permuted upper triangle of N."""

    @staticmethod
    def of(jacobian: sparse.csr_array) -> "Ordering":
        """Order the unknowns of derivatives (m, u) with any values (MATH 3.1)."""
        ones = sparse.csr_array((np.ones(len(jacobian.data)), jacobian.indices, jacobian.indptr), shape=jacobian.shape)
        # unknowns without observations stand on the diagonal too
        found = Elimination.of_pattern(sparse.csc_array(ones.T @ ones + sparse.eye_array(jacobian.shape[1])))
        where = assembly_places(found.upper_starts, found.upper_rows, found.places, jacobian.indptr, jacobian.indices)
        own = {each.name: getattr(found, each.name) for each in fields(found)}
        return Ordering(**own, columns=jacobian.indices, where=where)


class SymmetricFactor:
    """A symmetric positive definite matrix, scaled to a unit diagonal and factorised as L D Lᵀ."""

    def __init__(self, values: Array, ordering: Elimination, added: Array | None, least: float) -> None:
        """Factorise N plus a diagonal.

        Parameters
        ----------
        values
            Elements of the permuted upper triangle of N, columns one after the other; scaled in place.
        ordering
            Order of elimination.
        added
            (u,) to add to the diagonal of the scaled matrix: datum, damping, fictitious observations.
        least
            Pivots below it are answered by fictitious observations.
        """
        self._n = n = len(ordering.order)
        self.ordering = ordering
        extra = np.zeros(n) if added is None else np.ascontiguousarray(added[ordering.order])
        scale = scale_to_unit_diagonal(ordering.upper_starts, ordering.upper_rows, values, extra)
        self._rows, self._values, self._pivots, helped = factorise(
            n, ordering.upper_starts, ordering.upper_rows, values, ordering.parents, ordering.starts, least
        )
        self.scale: Array = scale[ordering.places]
        """(u,) 1/sqrt(N_kk); 1 for unknowns without observations."""
        self.helped: Array = helped[ordering.places]
        """(u,) True where a zero pivot was answered by a fictitious observation."""

    @staticmethod
    def of_matrix(
        matrix: sparse.csc_array, ordering: Elimination, added: Array | None = None, least: float = SMALLEST_PIVOT
    ) -> "SymmetricFactor":
        """Factorise a matrix (u, u) with the very pattern that was ordered (MATH 3.1)."""
        return SymmetricFactor(matrix.data[ordering.taken], ordering, added, least)

    def solved(self, right: Array) -> Array:
        """Solve N x = b for b (u,) or (u, k) (MATH 3.1)."""
        columns = right[:, None] if right.ndim == 1 else right
        work = np.ascontiguousarray((columns * self.scale[:, None])[self.ordering.order])
        solve_in_place(self._n, self.ordering.starts, self._rows, self._values, self._pivots, work)
        solution = work[self.ordering.places] * self.scale[:, None]
        return np.asarray(solution[:, 0] if right.ndim == 1 else solution)

    def free_directions(self) -> Array:
        """Give (u, f) vectors x with N x = 0 where pivots were zero; else that of the smallest pivot (MATH 3.1).

        With N = L D Lᵀ and d_k = 0 it is x = L⁻ᵀ e_k.
        """
        zero = np.flatnonzero(self.helped)
        if not len(zero):
            zero = self.ordering.order[[int(np.argmin(self._pivots))]]
        unit = np.zeros((self._n, len(zero)))
        unit[self.ordering.places[zero], np.arange(len(zero))] = 1.0
        lower = sparse.csc_array((self._values, self._rows, self.ordering.starts), shape=(self._n, self._n))
        upper = sparse.csr_array(lower.T + sparse.eye_array(self._n))
        found = spsolve_triangular(upper, unit, lower=False, unit_diagonal=True)
        return np.asarray(found[self.ordering.places] * self.scale[:, None])

    @cached_property
    def _inverse(self) -> tuple[Array, Array]:
        inverse, diagonal = selected_inverse(self._n, self.ordering.starts, self._rows, self._values, self._pivots)
        return inverse, diagonal

    def pieces(self) -> tuple[Array, Array, Array, Array, Array, Array]:
        """Give what compiled loops look elements up in (MATH 3.1)."""
        inverse, diagonal = self._inverse
        return self.ordering.places, self.ordering.starts, self._rows, inverse, diagonal, self.scale

    def elements(self, first: Array, second: Array) -> Array:
        """Give elements of N⁻¹ whose unknowns meet in an observation; NaN for others (MATH 3.1)."""
        inverse, diagonal = self._inverse
        found = inverse_elements(
            self.ordering.places, self.ordering.starts, self._rows, inverse, diagonal, first.ravel(), second.ravel()
        )
        return np.asarray(found * self.scale[first.ravel()] * self.scale[second.ravel()]).reshape(first.shape)

    def row_products(self, rows: sparse.csr_array, first: Array, second: Array) -> Array:
        """Give a_i N⁻¹ a_jᵀ for pairs of rows of one observation (MATH 3.1)."""
        if first is second:
            return np.asarray(row_squares(*self.pieces(), rows.indptr, rows.indices, rows.data, first))
        return np.asarray(row_products(*self.pieces(), rows.indptr, rows.indices, rows.data, first, second))

    def row_gains(self, rows: sparse.csr_array, numbers: Array, targets: Array) -> Array:
        """Give elements of N⁻¹ aᵀ at unknowns (k, t) that meet in rows (k,), (k, t) (MATH 3.1)."""
        return np.asarray(row_gains(*self.pieces(), rows.indptr, rows.indices, rows.data, numbers, targets))


class Factor(SymmetricFactor):
    """Normal equations N = Aᵀ P A, scaled to a unit diagonal and factorised as L D Lᵀ."""

    def __init__(
        self, jacobian: sparse.csr_array, weights: Array, ordering: Ordering, added: Array | None = None
    ) -> None:
        """Assemble and factorise N plus a diagonal.

        Parameters
        ----------
        jacobian
            (m, u) derivatives with the pattern that was ordered.
        weights
            (m,) weights of the rows, 0 for those that are left out.
        ordering
            Order of elimination.
        added
            (u,) to add to the diagonal of the scaled matrix: datum, damping, fictitious observations.
        """
        if not np.array_equal(jacobian.indices, ordering.columns):
            raise InvalidInputError("jacobian", "its pattern is not the one that was ordered")
        values = assemble(len(ordering.upper_rows), ordering.where, jacobian.indptr, jacobian.data, weights)
        super().__init__(values, ordering, added, SMALLEST_PIVOT)
