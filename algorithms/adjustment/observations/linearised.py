"""What every observation type gives the engine: contradictions and their derivatives, block by block (MATH 3.1)."""

from dataclasses import dataclass

import numpy as np

from algorithms.adjustment.unknowns import UnknownKind
from algorithms.arrays import Array, Indices


@dataclass(frozen=True, eq=False)
class Linearised:
    """n blocks of d residuals each at one pose, target from source.

    A block belongs to one correspondence. Features are described by k error parameters of their own (4 of a line, 3 of
    a plane or point, in the order of their covariances).
    """

    residuals: Array
    """(n, d) contradictions between moved source and target feature [rad, m]."""
    pose_jacobians: Array
    """(n, d, 6) derivatives by (rotation vector on the left, translation)."""
    target_jacobians: Array
    """(n, d, k) derivatives by the target feature's error parameters."""
    source_jacobians: Array
    """(n, d, k) derivatives by the source feature's error parameters."""


@dataclass(frozen=True, eq=False)
class FeatureNoise:
    """How the errors of n features come about: private ones, and errors of planes and photos shared with others
    (MATH 3.3).
    """

    total: Array
    """(n, k, k) covariance of each feature's error parameters, all causes together."""
    plane_numbers: Array
    """(n, j) numbers of the planes the feature depends on; -1 in all columns of a feature without planes."""
    plane_jacobians: Array
    """(n, k, 3 j) error parameters from those planes' (a1, a2, b), plane after plane."""
    station: int = -1
    """Station whose planes and photos are meant; -1 for features that share nothing."""
    photo_numbers: Array | None = None
    """(n, i) numbers of the photos on which the features depend, -1 where there is none; None for none at all."""
    photo_jacobians: Array | None = None
    """(n, k, 6 i) error parameters from the errors of these photos' mounts (rotation vector, translation)."""
    private: Array | None = None
    """(n, k, k) what neither planes nor mounts explain of `total`. None: nothing where a feature has planes, elsewhere
    all but the mounts' part."""

    @staticmethod
    def independent(covariances: Array) -> "FeatureNoise":
        """Describe features that share nothing with others.

        Parameters
        ----------
        covariances
            (n, k, k).
        """
        n, k = covariances.shape[:2]
        return FeatureNoise(covariances, np.full((n, 1), -1, dtype=np.int64), np.zeros((n, k, 3)))


@dataclass(frozen=True, eq=False)
class Derivative:
    """Derivatives of n blocks of residuals by one block of unknowns each."""

    kind: UnknownKind
    numbers: Indices
    """(n,) which pose or point."""
    jacobians: Array
    """(n, d, 6) or (n, d, 3)."""


@dataclass(frozen=True, eq=False)
class Equations:
    """n condition equations r(unknowns, observed) = 0 of d components each, linearised (Gauss-Helmert model).

    A Gauss-Markov observation is the special case whose derivative by what was observed is a unit matrix.
    """

    residuals: Array
    """(n, d) contradictions."""
    derivatives: tuple[Derivative, ...]
    """By the unknowns."""
    noise_jacobians: tuple[Array, ...]
    """By the observed quantities, (n, d, k) for each entry of `noises()`."""
