"""Registration by planes alone: what is left where a scan shows no lines that can be relied on."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, final

from algorithms.adjustment.options import AdjustmentOptions
from algorithms.features.options import FeatureOptions
from algorithms.matching.options import MatchingOptions
from algorithms.progress import Progress

if TYPE_CHECKING:
    # The web process describes the options without loading numpy: what the work needs is imported where it is done.
    import algorithms.arrays
    import algorithms.registration.base


@final
@dataclass(frozen=True)
class PlanesMethod:
    """Planes that both scans see, rigorously adjusted. The search uses lines too; the pose rests on planes alone."""

    name: ClassVar[str] = "planes"

    features: FeatureOptions = field(default_factory=FeatureOptions)
    """What counts as a feature."""
    matching: MatchingOptions = field(default_factory=MatchingOptions)
    """The search for the pose without a first guess."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """The fine adjustment and its tests."""

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
        from algorithms.registration.line_registration import FeatureUse, register_by_features

        return register_by_features(problem, FeatureUse(lines=False), self.matching, self.adjustment, progress)
