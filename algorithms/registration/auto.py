"""Registration by whatever two scans have: lines, planes and surfaces together, and what falls back on what."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, final

from algorithms.adjustment.options import AdjustmentOptions
from algorithms.features.options import FeatureOptions
from algorithms.matching.options import MatchingOptions
from algorithms.progress import Progress
from algorithms.registration.surface_options import SurfaceOptions

if TYPE_CHECKING:
    # The web process describes the options without loading numpy: what the work needs is imported where it is done.
    import algorithms.arrays
    import algorithms.registration.base


@final
@dataclass(frozen=True)
class AutoMethod:
    """Lines, planes and surfaces together; where they contradict each other or are too few, planes or surfaces alone.

    The result says which estimator gave the pose, and why.
    """

    name: ClassVar[str] = "auto"

    features: FeatureOptions = field(default_factory=FeatureOptions)
    """What counts as a feature."""
    matching: MatchingOptions = field(default_factory=MatchingOptions)
    """The search for the pose without a first guess."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """The fine adjustment of lines and planes, and its tests."""
    surfaces: SurfaceOptions = field(default_factory=SurfaceOptions)
    """The estimate by surfaces."""

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
        from algorithms.registration.auto_registration import register_automatically

        return register_automatically(problem, self.matching, self.adjustment, self.surfaces, progress)
