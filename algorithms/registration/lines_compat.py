"""The method of M. Lichtenstein's dissertation (RWTH Aachen 2011) as it stands there, for comparison."""

from dataclasses import dataclass, field
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


@dataclass(frozen=True)
class PairVotingOptions:
    """How pairs of lines vote for a motion; the dissertation names these quantities, but gives no numbers."""

    distance_per_angle_m: Annotated[float, Gt(0.0), Le(1000.0)] = 5.0
    """Weight of angle against distance in the correspondence matrix: a difference of one radian counts as so many
    metres [m/rad]."""
    max_angle_rad: Annotated[float, Gt(0.0), Le(0.5)] = 0.03
    """Lines that differ by less are parallel [rad]."""
    max_distance_m: Annotated[float, Gt(0.0), Le(1.0)] = 0.02
    """Lines nearer than this intersect, or are one line where they are parallel [m]."""
    max_entry_m: Annotated[float, Gt(0.0), Le(10.0)] = 0.05
    """Entries of the correspondence matrix above this are no match [m]."""
    max_lines: Annotated[int, Ge(3), Le(200)] = 80
    """So many of the longest lines of a scan form pairs."""
    max_pair_matches: Annotated[int, Ge(1), Le(200_000)] = 60_000
    """So many of the smallest entries of the correspondence matrix vote."""
    agreement_angle_rad: Annotated[float, Gt(0.0), Le(0.5)] = 0.02
    """Motions that differ by less agree [rad]."""
    agreement_distance_m: Annotated[float, Gt(0.0), Le(10.0)] = 0.05
    """The same for where they put the middle of the scan's lines [m]."""


@final
@dataclass(frozen=True)
class LinesCompatMethod:
    """The dissertation's method as printed, misprints corrected. For comparison: `lines` is better in every respect.

    Pairs of lines vote for a motion by angle and distance alone; the pose comes from six Plücker components per line
    with unit weights. That model depends on the origin: it is evaluated with the instruments as origins. The pose
    carries the covariance that the lines' noise really gives it; what the dissertation's formulas claim, and the
    rigorous pose of the same lines, stand beside.
    """

    name: ClassVar[str] = "lines-compat"

    features: FeatureOptions = field(default_factory=FeatureOptions)
    """What counts as a feature."""
    matching: MatchingOptions = field(default_factory=MatchingOptions)
    """The search for the pose without a first guess, which the result is verified against."""
    adjustment: AdjustmentOptions = field(default_factory=AdjustmentOptions)
    """The rigorous adjustment beside it, and its tests."""
    voting: PairVotingOptions = field(default_factory=PairVotingOptions)
    """The dissertation's coarse registration."""

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
        from algorithms.registration.compat_registration import register_as_dissertation

        return register_as_dissertation(problem, self, progress)
