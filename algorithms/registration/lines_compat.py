"""The method of M. Lichtenstein's dissertation (RWTH Aachen 2011) as it stands there, for comparison."""

from dataclasses import dataclass, field
from typing import Annotated, ClassVar, final

from annotated_types import Ge, Gt, Le

from algorithms.registration.method import OwnEstimateMethod


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
class LinesCompatMethod(OwnEstimateMethod):
    """The dissertation's method as printed, misprints corrected. For comparison: `lines` is better in every respect.

    Pairs of lines vote for a motion by angle and distance alone; the pose comes from six Plücker components per line
    with unit weights. That model depends on the origin: it is evaluated with the instruments as origins. The pose
    carries the covariance that the lines' noise really gives it; what the dissertation's formulas claim, and the
    rigorous pose of the same lines, stand beside.
    """

    name: ClassVar[str] = "lines-compat"
    work: ClassVar[str] = "algorithms.registration.compat_registration:register_as_dissertation"

    voting: PairVotingOptions = field(default_factory=PairVotingOptions)
    """The dissertation's coarse registration."""
