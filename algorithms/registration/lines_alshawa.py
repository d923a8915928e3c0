"""Registration by linear features after Alshawa (Lichtenstein 2011, eqs. 2.1 to 2.4), for comparison."""

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
class LinesAlshawaMethod:
    """Alshawa's estimator: rotation first, then translation, two conditions per line each. For comparison.

    The pose is the estimator's own, with the covariance that the lines' noise gives it; the rigorous pose of the same
    lines stands beside. Lines without a difference in Z, for which the printed equations are singular, are projected
    along X or Y instead. Small-angled, it starts from the search.
    """

    name: ClassVar[str] = "lines-alshawa"

    features: FeatureOptions = field(default_factory=FeatureOptions)
    """What counts as a feature."""
    matching: MatchingOptions = field(default_factory=MatchingOptions)
    """The search for the pose without a first guess: start of the estimate, and what it is verified against."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """The rigorous adjustment beside it, and its tests."""

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
        from algorithms.registration.alshawa_registration import register_by_alshawa

        return register_by_alshawa(problem, self, progress)
