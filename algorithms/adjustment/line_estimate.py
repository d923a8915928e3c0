"""What another estimator than the rigorous one gives: pose, honest covariance, and its own figures (MATH 3.2)."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.arrays import Flags, IndexPairs
from algorithms.geometry.line_pairs_geometry import LinePairs, pair_geometry
from algorithms.geometry.lines import Lines
from algorithms.geometry.poses import PoseEstimate


@dataclass(frozen=True)
class EstimatorStep:
    """One least-squares step of an estimator, with the figures it reports of itself (MATH 3.2)."""

    name: str
    """What it determines."""
    equations: int
    """Number of its equations."""
    unknowns: int
    """Number of its unknowns."""
    sigma0: float | None
    """Its standard deviation of unit weight; None where it has no more equations than unknowns."""
    iterations: int
    """Rounds until it stopped."""
    last_step: float
    """Norm of the last step [rad and m as they come]."""
    converged: bool
    """Whether the steps became as small as the method asks, or as rounding lets them."""

    @property
    def redundancy(self) -> int:
        """Equations minus unknowns, as the estimator counts them."""
        return self.equations - self.unknowns


@dataclass(frozen=True, eq=False)
class LineEstimate:
    """A pose estimated from matched lines by a method of its own (MATH 3.2)."""

    pose: PoseEstimate
    """The pose with the covariance that the lines' noise really gives it in this estimator."""
    claimed: PoseEstimate
    """The same pose with the covariance that the estimator reports of itself."""
    steps: tuple[EstimatorStep, ...]
    """Its least-squares steps in order."""
    declared: Flags
    """(n,) True for lines that its own test declares outliers; all False where it has no test."""
    remarks: tuple[str, ...] = ()
    """What was chosen where the source leaves a choice, in words."""

    @property
    def converged(self) -> bool:
        """Whether all steps settled."""
        return all(step.converged for step in self.steps)


@dataclass(frozen=True)
class Closeness:
    """How near corresponding lines lie, as the dissertation's tables 4.1 to 5.5 give it."""

    max_angle_rad: float
    """Largest angle between corresponding lines [rad]."""
    max_distance_m: float
    """Largest of the shortest distances between corresponding (endless) lines [m]."""


def closeness(target: Lines, source: Lines, pairs: IndexPairs, target_from_source: RigidTransform) -> Closeness:
    """Measure angle and shortest distance of corresponding lines in a pose (Lichtenstein 2011, eqs. 4.16, 4.19, 4.20).

    The shortest distance of two endless lines may lie far from where they were seen, so it is smaller than their
    distance there.

    Parameters
    ----------
    target, source
        Lines of both scans.
    pairs
        (n, 2) numbers of target line and source line, n > 0.
    target_from_source
        Pose.
    """
    target, source = target[pairs[:, 0]], source[pairs[:, 1]]
    moved = target_from_source.rotation.apply(source.directions)
    both = LinePairs(target.anchors, target.directions, target_from_source.apply(source.anchors), moved)
    sines = np.linalg.norm(np.cross(target.directions, moved), axis=1)
    return Closeness(float(np.arcsin(np.minimum(sines, 1.0)).max()), float(pair_geometry(both).distances_m.max()))
