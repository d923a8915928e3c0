"""What every registration method takes and gives."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from algorithms.adjustment.hybrid.tied_results import PointTest
from algorithms.adjustment.line_adjustment import LineAdjustment
from algorithms.adjustment.line_estimate import EstimatorStep
from algorithms.adjustment.rank import CentredFrame
from algorithms.arrays import Flags, IndexPairs, OtherIndexPairs, Points, Vector3
from algorithms.evidence.place import Place
from algorithms.features.scan_features import ScanFeatures
from algorithms.geometry.poses import PoseEstimate
from algorithms.matching.coarse_registration import CoarseRegistration
from algorithms.matching.priors import PairPriors
from algorithms.quality.acceptance import Verification
from algorithms.registration.rigidity import Rigidity
from algorithms.registration.surface_estimate import SurfaceEstimate
from algorithms.targets.common_points import TargetSet


class PairStatus(StrEnum):
    """What is to be thought of a pair's pose."""

    ACCEPTED = "accepted"
    COARSE = "coarse"
    """In place, less precise than asked."""
    DOUBTFUL = "doubtful"
    REJECTED = "rejected"
    AMBIGUOUS = "ambiguous"
    DEGENERATE = "degenerate"

    @property
    def in_place(self) -> bool:
        """Whether the pose is certainly the right one, however well it is known."""
        return self in {PairStatus.ACCEPTED, PairStatus.COARSE}


@dataclass(frozen=True)
class Tolerance:
    """Standard deviations that a request asks of poses; None: not stated."""

    std_m: float | None = None
    """Of positions [m]."""
    std_rad: float | None = None
    """Of turns [rad]."""


@dataclass(frozen=True)
class Precision:
    """How well a determined pose is known."""

    allowed_m: float
    """Standard deviation allowed at the far end: the tolerance, or what the scans allow [m]."""
    is_stated: bool
    """Whether a request states that tolerance."""
    centre_std_m: float
    """Standard deviation of the worst motion where the common features and surfaces are [m]."""
    far_m: float
    """Distance of the far end from there [m]."""
    far_std_m: float
    """Standard deviation of the worst motion at the far end [m]."""
    turn_std_rad: float
    """Standard deviation of the worst turn [rad]."""
    hidden_m: float
    """Shift of the pose by the largest error that no test finds [m]; inf: any error could hide."""
    findings: tuple[str, ...] = ()
    """What exceeds the tolerance, and what contradicts the precision, in words; empty: it is kept."""

    @property
    def is_kept(self) -> bool:
        """Whether the pose is as precise as asked."""
        return not self.findings


@dataclass(frozen=True, eq=False)
class RegistrationProblem:
    """Two scans' features; wanted is the motion of the source into the target's frame."""

    target: ScanFeatures
    source: ScanFeatures
    priors: PairPriors | None = None
    """What is known of the stations beforehand: levelling, approximate poses; None: nothing."""
    target_points: TargetSet | None = None
    """Survey targets of the target station, in its reduced frame; None: there are none."""
    source_points: TargetSet | None = None
    """Those of the source station."""
    tolerance: Tolerance | None = None
    """Precision that the request asks of a pose; None: what the scans allow."""


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
    """Target from source between the files' full coordinates: the method's own estimate. Its covariance is what the
    noise of the features makes of it in that estimator, a-posteriori where the residuals are larger than the scans' own
    noise explains."""
    centroid_m: Vector3
    """(3,) centroid of the used features, full target coordinates [m]."""


@dataclass(frozen=True)
class ConvergenceStep:
    """One iteration of a method that comes to its pose step by step."""

    misfit_m: float
    """Weighted rms of what it minimises, before the step [m]."""
    step_m: float
    """How far the step moves the scan: shift of the centre and turn, as the shift it causes at the rms distance [m]."""
    correspondences: int
    """Which it rests on."""


@dataclass(frozen=True, eq=False)
class OwnFigures:
    """What a method that is not the rigorous one says of its own result, to be compared with, not to be relied on."""

    label: str
    """Which estimator this is, in words."""
    pose: PoseEstimate
    """The method's pose between the files' full coordinates with the covariance it claims itself."""
    steps: tuple[EstimatorStep, ...]
    """Its least-squares steps with equations, unknowns, sigma0 and iterations as it counts them."""
    lines: IndexPairs
    """(n, 2) numbers of the target and source lines it used."""
    declared_outliers: OtherIndexPairs
    """(m, 2) those of them that its own test declares outliers; they stay in its estimate."""
    max_angle_rad: float | None
    """Largest angle between corresponding lines in its pose [rad]; None: it uses no lines."""
    max_distance_m: float | None
    """Largest shortest distance between corresponding (endless) lines in its pose [m]; None likewise."""
    remarks: tuple[str, ...]
    """What was chosen where the source of the method leaves a choice, in words."""
    convergence: tuple[ConvergenceStep, ...] = ()
    """Its iterations one after the other; empty where it does not iterate to one pose."""
    rate: float | None = None
    """By which factor its steps shrink at last; None: too few."""
    order: float | None = None
    """Its order of convergence: 1 linear, 2 quadratic; None: too few steps."""


@dataclass(frozen=True)
class PosePart:
    """What one estimate contributes to a pose."""

    name: str
    """What it rests on, in words."""
    share: float
    """Its share of the information, averaged over the motions that the pose determines, 0..1."""


@dataclass(frozen=True, eq=False)
class TargetFit:
    """Survey targets that two stations have in common, and the pose that they give alone."""

    names: tuple[str, ...]
    """What each common target is called; of those without a name their numbers in both stations."""
    pairs: IndexPairs
    """(n, 2) their numbers in the target station and in the source station."""
    residuals_m: Points
    """(n, 3) R x1 + t - x2 in the target's axes; of those that were left out with the pose of the others [m]."""
    tests: PointTest
    """Of the source's measurements: test values, redundancy, smallest errors that would be found."""
    used: Flags
    """(n,) False for those that were left out as gross errors."""
    pose: PoseEstimate
    """Target from source between the reduced frames, a posteriori where the residuals are too large."""
    centred: CentredFrame
    """Centre and rms radius of the used ones, reduced target frame."""
    omega: float
    redundancy: int
    hidden_m: float
    """How far an error that just stays undetected shifts the pose at their centre; inf where one is not controlled."""
    reason: str
    """How they were recognised, in words."""

    @property
    def is_controlled(self) -> bool:
        """Say whether an error in any one of them would be found."""
        return bool(np.isfinite(self.hidden_m))


@dataclass(frozen=True, eq=False)
class FinalPose:
    """A pose to be judged, and where it comes from."""

    pose: PoseEstimate
    """Target from source between the files' full coordinates."""
    reduced: PoseEstimate
    """The same between the reduced frames."""
    centred: CentredFrame
    """Centre, reduced target frame, and rms radius of what the pose rests on."""
    centre_m: Vector3
    """(3,) the same centre in full target coordinates [m]."""
    estimator: str
    """Which estimator gave it: lines+planes+surfaces, planes+surfaces, surfaces, lines+planes, planes or lines, each
    with +targets where survey targets take part, or targets."""
    reason: str
    """Why, in words with figures."""
    parts: tuple[PosePart, ...]
    """What the pose is made of, the largest share first."""
    feature_share: float
    """Share of the information that lines and planes give, 0..1; the rest comes from surfaces."""
    surfaces: SurfaceEstimate | None
    """The estimate by surfaces alone; None where too little surface lies on surface."""
    free_directions: tuple[str, ...] = ()
    """Motions that nothing determines, in words."""
    advice: str = ""
    """What to add then."""
    without_targets: PoseEstimate | None = None
    """What lines, planes and surfaces say of it alone, between the reduced frames, where survey targets take part;
    None: none do, or there is nothing else."""


@dataclass(frozen=True, eq=False)
class PairResult:
    """What came out for two scans. Parts that a failure left out are None, with the reason in `reasons`."""

    status: PairStatus
    reasons: tuple[str, ...]
    """Why the status is what it is, in words with figures."""
    coarse: CoarseRegistration | None
    """Coarse registration between the reduced frames; of methods with a search or start of their own the one that their
    pose was verified against."""
    fine: FineRegistration | None
    verification: Verification | None
    """Overlap and free space in the final pose."""
    free_directions: tuple[str, ...] = ()
    """What the geometry of a scan leaves free before any pose is looked for, in words."""
    advice: str = ""
    """What to add then."""
    rigorous: PoseEstimate | None = None
    """For methods with an estimator of their own: the pose of the rigorous adjustment (`fine.adjustment`) of the same
    correspondences between the files' full coordinates, with the covariance that `auto` gives one of features alone.
    For methods that propose a pose: that of the service's own estimate from there on, which is the answer (`final`)."""
    own_figures: OwnFigures | None = None
    """What such a method says of itself."""
    final: FinalPose | None = None
    """The pose, and which estimator gave it; None for methods with an estimator of their own. The pose of `fine`, where
    there is one, is the same then, and its adjustment is that of the lines and planes in it."""
    rigidity: Rigidity | None = None
    """Whether the scans differ by more than a motion; None where no pose was worth the question."""
    targets: TargetFit | None = None
    """Survey targets in common; None: there are too few, or the method does not ask for them."""
    place: Place | None = None
    """How probable the pose is by the evidence, beside others; below one half it is not accepted. None: no pose was
    worth the question."""
    precision: Precision | None = None
    """How well the pose is known; None: there is none, or it leaves motions free."""

    @staticmethod
    def without_pose(status: PairStatus, reason: str) -> "PairResult":
        """Say that there is no pose, and why."""
        return PairResult(status, (reason,), None, None, None)
