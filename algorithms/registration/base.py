"""What every registration method takes and gives."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

import numpy as np

from algorithms.adjustment.line_adjustment import LineAdjustment
from algorithms.arrays import IndexPairs, OtherIndexPairs, Vector3
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.progress import Progress
from algorithms.quality.acceptance import Verification


class PairStatus(StrEnum):
    """What is to be thought of a pair's pose."""

    ACCEPTED = "accepted"
    DOUBTFUL = "doubtful"
    REJECTED = "rejected"
    AMBIGUOUS = "ambiguous"
    DEGENERATE = "degenerate"


@dataclass(frozen=True, eq=False)
class RegistrationProblem:
    """Two scans' features; wanted is the motion of the source into the target's frame."""

    target: ScanFeatures
    source: ScanFeatures


@dataclass(frozen=True, eq=False)
class FineRegistration:
    """The adjusted pose and what it rests on."""

    lines: IndexPairs
    """(n, 2) numbers of corresponding target and source lines."""
    planes: OtherIndexPairs
    """(m, 2) numbers of corresponding target and source planes."""
    adjustment: LineAdjustment
    """Between the reduced frames."""
    pose: PoseEstimate
    """Target from source between the files' full coordinates. Its covariance is the a-posteriori one where the
    residuals are larger than the scans' own noise explains."""
    centroid_m: Vector3
    """(3,) centroid of the used features, full target coordinates [m]."""


@dataclass(frozen=True, eq=False)
class PairResult:
    """What came out for two scans. Parts that a failure left out are None, with the reason in `reasons`."""

    status: PairStatus
    reasons: tuple[str, ...]
    """Why the status is what it is, in words with figures."""
    coarse: CoarseRegistration | None
    """Coarse registration between the reduced frames."""
    fine: FineRegistration | None
    verification: Verification | None
    """Overlap and free space in the final pose."""
    free_directions: tuple[str, ...] = ()
    """What the geometry of a scan leaves free before any pose is looked for, in words."""
    advice: str = ""
    """What to add then."""

    @staticmethod
    def without_pose(status: PairStatus, reason: str) -> "PairResult":
        """Say that there is no pose, and why."""
        return PairResult(status, (reason,), None, None, None)


class RegistrationMethod(Protocol):
    """One way to register two scans; its fields are its options."""

    def register(self, problem: RegistrationProblem, *, progress: Progress, rng: np.random.Generator) -> PairResult:
        """Find target_from_source.

        A pose that must not be trusted is a result with a status and reasons; geometry or data that allow no pose at
        all are one too (`degenerate`, `rejected`).
        """
        ...
