"""Iterative closest line after Alshawa, for comparison."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, ClassVar, final

from annotated_types import Ge, Gt, Le

from algorithms.adjustment.options import AdjustmentOptions
from algorithms.features.options import FeatureOptions
from algorithms.matching.options import MatchingOptions
from algorithms.progress import Progress

if TYPE_CHECKING:
    # The web process describes the options without loading numpy: what the work needs is imported where it is done.
    import algorithms.arrays
    import algorithms.registration.base


class IclStart(StrEnum):
    """Where the iteration starts."""

    MATCHING = "matching"
    """At the answer of the search without a first guess."""
    IDENTITY = "identity"
    """Where the files' coordinates put the scans: for scans that lie roughly in one frame already."""


@final
@dataclass(frozen=True)
class IclMethod:
    """Iterative closest line: closest lines and Alshawa's estimate in turns until nothing changes. For comparison.

    The pose is the estimator's own, with the covariance that the lines' noise gives it; the rigorous pose of the same
    lines stands beside.
    """

    name: ClassVar[str] = "icl"

    features: FeatureOptions = field(default_factory=FeatureOptions)
    """What counts as a feature."""
    matching: MatchingOptions = field(default_factory=MatchingOptions)
    """The search for the pose without a first guess: what the result is verified against, and a start."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """The rigorous adjustment beside it, and its tests."""
    start: IclStart = IclStart.MATCHING
    """Where the iteration starts."""
    max_angle_rad: Annotated[float, Gt(0.0), Le(0.8)] = 0.035
    """Largest angle of closest lines in the first rounds [rad]; it narrows while the correspondences settle."""
    max_distance_m: Annotated[float, Gt(0.0), Le(10.0)] = 0.1
    """Largest distance of closest lines in the first rounds [m]."""
    max_iterations: Annotated[int, Ge(1), Le(1000)] = 50
    """Limit of rounds."""

    def register(
        self,
        problem: "algorithms.registration.base.RegistrationProblem",
        *,
        progress: Progress,
        rng: "algorithms.arrays.Generator",  # noqa: ARG002 - every method has it; this one draws nothing
    ) -> "algorithms.registration.base.PairResult":
        """Find target_from_source.

        Parameters
        ----------
        problem
            Features of both scans.
        progress
            Is told the steps matching, adjustment and verification.
        rng
            Not used: the method is deterministic.
        """
        from algorithms.registration.icl_registration import register_by_closest_lines

        return register_by_closest_lines(problem, self, progress)
