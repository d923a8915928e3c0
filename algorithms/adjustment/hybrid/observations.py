"""What a group of observations is: numbers of what takes part, values, covariances, and what they are called."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from algorithms.adjustment.hybrid.state import Kind, State
from algorithms.arrays import Array, Indices


@dataclass(frozen=True, eq=False)
class Block:
    """Derivatives of n conditions of size d by one block of unknowns each."""

    kind: Kind
    numbers: Indices
    """(n,) numbers of the blocks."""
    jacobians: Array
    """(n, d, size)."""


@dataclass(frozen=True, eq=False)
class Stacked:
    """Contradictions, computed minus observed, and their derivatives."""

    residuals: Array
    """(n, d)."""
    blocks: tuple[Block, ...]


@dataclass(frozen=True, eq=False)
class Observations(ABC):
    """n observations of one type with d components each: the common part of all types."""

    covariances: Array
    """(n, d, d) a-priori covariances."""
    is_form: ClassVar[bool] = False
    """Whether it says something of a form only, which no common motion and no scale changes."""

    @property
    def size(self) -> int:
        """Number of components d (MATH 3.1)."""
        return int(self.covariances.shape[1])

    def __len__(self) -> int:
        return len(self.covariances)

    @abstractmethod
    def stacked(self, state: State) -> Stacked:
        """Compute contradictions and derivatives at given values (MATH 3.1)."""

    @property
    @abstractmethod
    def places(self) -> Sequence[tuple[Kind, Indices]]:
        """Give kind and numbers (n,) of the unknowns that take part (MATH 3.1)."""

    def metres(self, state: State) -> Array:
        """Give what one unit of each component means at the object [m], (n, d) (MATH 3.1)."""
        del state
        return np.ones((len(self), self.size))


def variances(stds: Array) -> Array:
    """Give (n, 1, 1) covariances of single observations from their standard deviations (n,) (MATH 3.1)."""
    return np.square(np.asarray(stds, dtype=np.float64))[:, None, None]
