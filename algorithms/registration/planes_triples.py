"""The symbolic matching of planes by Dold and Brenner, for comparison and as a search of its own."""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, ClassVar, final

from annotated_types import Ge, Gt, Le

from algorithms.adjustment.options import AdjustmentOptions
from algorithms.features.options import FeatureOptions
from algorithms.matching.options import MatchingOptions
from algorithms.progress import Progress
from algorithms.registration.surface_options import SurfaceOptions

if TYPE_CHECKING:
    # The web process describes the options without loading numpy: what the work needs is imported where it is done.
    import algorithms.arrays
    import algorithms.registration.base


@dataclass(frozen=True)
class TripleOptions:
    """How triples of planes are laid on each other; the paper gives the number of planes only."""

    max_planes: Annotated[int, Ge(3), Le(100)] = 50
    """So many planes of each scan take part, the largest: most points lie on what is near."""
    max_triples: Annotated[int, Ge(1), Le(20_000)] = 6000
    """So many triples of each scan are tried, those of the largest triple product: three planes that stand square to
    each other have 1."""
    least_product: Annotated[float, Gt(0.0), Le(1.0)] = 0.3
    """Triples with a smaller triple product fix no pose."""
    max_cosine_difference: Annotated[float, Gt(0.0), Le(0.2)] = 0.02
    """Angles between the planes of two triples that differ by more, as cosines, are not those of the same planes."""
    max_angle_rad: Annotated[float, Gt(0.0), Le(0.5)] = 0.02
    """Planes agree when their normals differ by less [rad]."""
    max_distance_m: Annotated[float, Gt(0.0), Le(2.0)] = 0.15
    """And when the middle of one lies no farther from the other [m]."""
    max_gap_m: Annotated[float, Ge(0.0), Le(10_000.0)] = 20.0
    """And when they are no farther apart from rim to rim: two scans see two pieces of one street [m]."""
    max_shift_m: Annotated[float, Gt(0.0), Le(10_000.0)] = 200.0
    """The middles of the scans are no farther apart [m]."""
    max_poses: Annotated[int, Ge(1), Le(20_000_000)] = 1_500_000
    """So many poses are counted at most."""


@final
@dataclass(frozen=True)
class PlanesTriplesMethod:
    """Triples of planes propose the pose (Dold, Ripperda and Brenner 2007): the one in which most planes agree.

    Triples of both scans are laid on each other, the most orthogonal ones first; the pose comes from the quaternion of
    the normals and least squares. Beyond the paper, planes agree only where they come near each other, and of the best
    poses the one in which most surface lies on surface is taken. The service estimates from there on; what the method
    says itself stands beside.
    """

    name: ClassVar[str] = "planes-triples"

    features: FeatureOptions = field(default_factory=FeatureOptions)
    """What counts as a feature."""
    matching: MatchingOptions = field(default_factory=MatchingOptions)
    """The search that the result is verified against."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """The estimate from the proposed pose on: lines and planes."""
    surfaces: SurfaceOptions = field(default_factory=SurfaceOptions)
    """The estimate from the proposed pose on: surfaces."""
    triples: TripleOptions = field(default_factory=TripleOptions)
    """The method's own search."""

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
        from algorithms.registration.triples_registration import register_by_triples

        return register_by_triples(problem, self, progress)
