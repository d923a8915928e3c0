"""Iterative closest points by approximants of the squared distance."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, final

from algorithms.adjustment.options import AdjustmentOptions
from algorithms.features.options import FeatureOptions
from algorithms.matching.options import MatchingOptions
from algorithms.progress import Progress
from algorithms.registration.icp_options import IcpOptions
from algorithms.registration.surface_options import SurfaceOptions

if TYPE_CHECKING:
    # The web process describes the options without loading numpy: what the work needs is imported where it is done.
    import algorithms.arrays
    import algorithms.registration.base


@final
@dataclass(frozen=True)
class IcpD2Method:
    """Quadratic approximants of the squared distance from the surface, minimised in turns (Hofer and Pottmann 2004).

    Between point to point and point to plane by distance and curvature; each step is the helical motion of a velocity
    field. Only points near the other surface take part, large distances count less, and every iteration is recorded.
    The service estimates from there on; what the method says itself stands beside.
    """

    name: ClassVar[str] = "icp-d2"

    features: FeatureOptions = field(default_factory=FeatureOptions)
    """What counts as a feature."""
    matching: MatchingOptions = field(default_factory=MatchingOptions)
    """The search that the result is verified against."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """The estimate from the proposed pose on: lines and planes."""
    surfaces: SurfaceOptions = field(default_factory=SurfaceOptions)
    """The estimate from the proposed pose on: surfaces."""
    iteration: IcpOptions = field(default_factory=IcpOptions)
    """The method's own iteration."""

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
        from algorithms.closest_points.iteration import ErrorKind
        from algorithms.registration.icp_registration import register_by_iteration

        return register_by_iteration(
            problem, ErrorKind.D2, self.iteration, self.matching, self.adjustment, self.surfaces, progress
        )
