"""What every observation type gives the engine: residuals and their derivatives, block by block."""

from dataclasses import dataclass

from algorithms.arrays import Array


@dataclass(frozen=True, eq=False)
class Linearised:
    """n blocks of d residuals each at one pose.

    A block belongs to one correspondence. Features are described by k error parameters of their own (4 of a line, 3 of
    a plane, in the order of their covariances).
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
    """How the errors of n features come about: private ones, or errors of planes they share with others."""

    private: Array
    """(n, k, k) covariance of each feature's error parameters, all causes together."""
    plane_numbers: Array
    """(n, j) numbers of the planes the feature depends on; -1 in all columns of a feature without planes."""
    plane_jacobians: Array
    """(n, k, 3 j) error parameters from those planes' (a1, a2, b), plane after plane."""
