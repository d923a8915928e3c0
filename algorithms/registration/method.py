"""What every registration method is: options, and the function that does the work with them."""

from dataclasses import dataclass, field
from pkgutil import resolve_name
from typing import TYPE_CHECKING, ClassVar, cast

from algorithms.adjustment.options import AdjustmentOptions
from algorithms.features.options import FeatureOptions
from algorithms.matching.options import MatchingOptions
from algorithms.progress import Progress
from algorithms.registration.surface_options import SurfaceOptions

if TYPE_CHECKING:
    # The web process describes the options without loading numpy: what the work needs is loaded where it is done.
    import algorithms.registration.base


@dataclass(frozen=True)
class Method:
    """One way to register two scans; its fields are its options.

    A method draws nothing at random: the same features give the same answer.
    """

    name: ClassVar[str]
    """As requests name it."""
    work: ClassVar[str]
    """`module:function` of the work, called with the problem, the method and the progress; loaded where it is done."""

    features: FeatureOptions = field(default_factory=FeatureOptions)
    """What counts as a feature."""
    matching: MatchingOptions = field(default_factory=MatchingOptions)
    """The search for the pose without a first guess."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """The fine adjustment of lines and planes, and its tests."""

    def register(
        self, problem: "algorithms.registration.base.RegistrationProblem", *, progress: Progress
    ) -> "algorithms.registration.base.PairResult":
        """Find target_from_source.

        A pose that must not be trusted is a result with a status and reasons; geometry or data that allow no pose at
        all are one too (`degenerate`, `rejected`).

        Parameters
        ----------
        problem
            Features of both scans.
        progress
            Is told the steps matching, adjustment and verification.
        """
        result = resolve_name(self.work)(problem, self, progress)
        return cast("algorithms.registration.base.PairResult", result)


@dataclass(frozen=True)
class OwnEstimateMethod(Method):
    """A method with an estimator of its own, for comparison; the rigorous pose of the same lines stands beside."""

    matching: MatchingOptions = field(default_factory=MatchingOptions)
    """The search for the pose without a first guess: a start, and what the result is verified against."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """The rigorous adjustment beside it, and its tests."""


@dataclass(frozen=True)
class ProposingMethod(Method):
    """A method that proposes a pose; the service estimates from there on, and its own figures stand beside."""

    matching: MatchingOptions = field(default_factory=MatchingOptions)
    """The search that the result is verified against."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """The estimate from the proposed pose on: lines and planes."""
    surfaces: SurfaceOptions = field(default_factory=SurfaceOptions)
    """The estimate from the proposed pose on: surfaces."""
