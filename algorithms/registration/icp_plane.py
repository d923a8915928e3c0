"""Registration by surfaces alone: point to plane in both directions, from the answer of the search."""

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
class IcpPlaneMethod:
    """Surfaces alone, robustly laid on each other point to plane (Chen and Medioni 1992), from the search's answer.

    The covariance comes from the misfits, those of a neighbourhood counted as one. Lines and planes serve the search
    only.
    """

    name: ClassVar[str] = "icp-plane"

    features: FeatureOptions = field(default_factory=FeatureOptions)
    """What counts as a feature."""
    matching: MatchingOptions = field(default_factory=MatchingOptions)
    """The search for the pose without a first guess."""
    surfaces: SurfaceOptions = field(default_factory=SurfaceOptions)
    """The estimate."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """Of three and more stations together; a pair does not use it."""

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
        from algorithms.registration.auto_registration import register_by_surfaces

        return register_by_surfaces(problem, self.matching, self.surfaces, progress)
