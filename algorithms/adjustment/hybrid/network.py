"""A hybrid network: unknowns, observations and their linearisation, whitened and sparse (MATH 3.1, 6)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from algorithms.adjustment.hybrid.observations import Observations
from algorithms.adjustment.hybrid.sparse_factor import Ordering
from algorithms.adjustment.hybrid.state import Layout, State
from algorithms.arrays import Array, Indices
from algorithms.errors import InvalidInputError


@dataclass(frozen=True, eq=False)
class Linearised:
    """All observations at one set of values, divided by their standard deviations; m rows, u unknowns."""

    residuals: Array
    """(m,) contradictions, computed minus observed, whitened."""
    jacobian: sparse.csr_array
    """(m, u) whitened derivatives."""
    raw_residuals: Array
    """(m,) in their own units."""


@dataclass(frozen=True, eq=False)
class Network:
    """Observations and the columns of what they depend on."""

    observations: Sequence[Observations]
    """Types; their entries are numbered through as blocks, their components as rows."""
    layout: Layout

    @cached_property
    def sizes(self) -> Indices:
        """(blocks,) components of each block (MATH 3.1)."""
        return np.concatenate([np.full(len(each), each.size, dtype=np.int64) for each in self.observations])

    @cached_property
    def first_rows(self) -> Indices:
        """(blocks + 1,) first row of each block (MATH 3.1)."""
        return np.concatenate([[0], np.cumsum(self.sizes)]).astype(np.int64)

    @cached_property
    def block_of_row(self) -> Indices:
        """(m,) block of each row (MATH 3.1)."""
        return np.repeat(np.arange(len(self.sizes)), self.sizes)

    @cached_property
    def first_blocks(self) -> Indices:
        """(types + 1,) first block of each type (MATH 3.1)."""
        return np.concatenate([[0], np.cumsum([len(each) for each in self.observations])]).astype(np.int64)

    @cached_property
    def whiteners(self) -> Sequence[Array]:
        """For each type (n, d, d) inverses of the Cholesky factors of its covariances (MATH 3.1)."""
        found = []
        for each in self.observations:
            if each.size == 1:
                found.append(1.0 / np.sqrt(each.covariances))
                continue
            try:
                roots = np.linalg.cholesky(each.covariances)
            except np.linalg.LinAlgError as error:
                raise InvalidInputError("covariance", "it is not positive definite") from error
            found.append(np.linalg.solve(roots, np.broadcast_to(np.eye(each.size), roots.shape)))
        return found

    @cached_property
    def stds(self) -> Array:
        """(m,) a-priori standard deviations (MATH 3.1)."""
        return np.concatenate([
            np.sqrt(np.einsum("nii->ni", each.covariances)).ravel() for each in self.observations
        ])  # fmt: skip

    def linearised(self, state: State) -> Linearised:
        """Compute residuals and derivatives at given values and divide by the standard deviations (MATH 3.1)."""
        rows, columns, values, residuals, raw, first = [], [], [], [], [], 0
        for each, whitener in zip(self.observations, self.whiteners, strict=True):
            n, d = len(each), each.size
            stacked = each.stacked(state)
            raw.append(stacked.residuals.ravel())
            residuals.append(np.einsum("nij,nj->ni", whitener, stacked.residuals).ravel())
            numbers = first + np.arange(n * d).reshape(n, d)
            for block in stacked.blocks:
                at = self.layout.columns[block.kind][block.numbers]
                if not (at >= 0).any():
                    continue
                white = whitener @ block.jacobians
                at = np.broadcast_to(at[:, None, :], white.shape)
                kept = at >= 0
                rows.append(np.broadcast_to(numbers[:, :, None], white.shape)[kept])
                columns.append(at[kept])
                values.append(white[kept])
            first += n * d
        shape = (first, self.layout.count)
        if not rows:
            return Linearised(np.concatenate(residuals), sparse.csr_array(shape), np.concatenate(raw))
        entries = (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns)))
        jacobian = sparse.csr_array(sparse.coo_array(entries, shape=shape))
        return Linearised(np.concatenate(residuals), jacobian, np.concatenate(raw))

    def ordering(self, jacobian: sparse.csr_array) -> Ordering:
        """Order the unknowns for elimination; the pattern is that of all observations, used or not (MATH 3.1)."""
        if "_ordering" not in self.__dict__:
            self.__dict__["_ordering"] = Ordering.of(jacobian)
        ordering: Ordering = self.__dict__["_ordering"]
        return ordering

    def metres(self, state: State) -> Array:
        """Give what a unit of each row means at the object [m], (m,) (MATH 3.1)."""
        return np.concatenate([each.metres(state).ravel() for each in self.observations])
