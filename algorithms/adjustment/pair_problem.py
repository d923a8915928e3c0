"""The problem of two stations: one pose, target from source, by whatever both have seen (MATH 3.1)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from algorithms.adjustment.observations import PairObservation
from algorithms.adjustment.problem import LinearSystem, Problem
from algorithms.adjustment.unknowns import Unknowns
from algorithms.arrays import Array, Points, Vector3


def by_station(target: Array | None, source: Array | None) -> Mapping[int, Array]:
    """Name what the features of the target (0) and of the source (1) share; None: nothing (MATH 2.5, 3.3)."""
    return {k: covariances for k, covariances in enumerate((target, source)) if covariances is not None}


@dataclass(frozen=True, eq=False)
class PairProblem(Problem):
    """Correspondences that together determine one pose; station 0 is the target, 1 the source (MATH 3.1)."""

    observations: Sequence[PairObservation]

    def about(self, target_origin_m: Vector3, source_origin_m: Vector3) -> "PairProblem":
        """Give the same problem between frames whose origins lie at the given points."""
        return replace(
            self, observations=tuple(part.about(target_origin_m, source_origin_m) for part in self.observations)
        )

    def target_points(self) -> Points:
        """Give the points (k, 3) that show where the target geometry is [m]."""
        return np.vstack([part.target_points() for part in self.observations])

    def source_points(self) -> Points:
        """Give the points (k, 3) that show where the source geometry is [m]."""
        return np.vstack([part.source_points() for part in self.observations])

    def at(self, pose: RigidTransform) -> LinearSystem:
        """Linearise at a pose, target from source."""
        return self.linearised(Unknowns.of_pair(pose))
