"""Options of matching; light to import, because the web process describes them."""

from dataclasses import dataclass
from typing import Annotated

from annotated_types import Ge, Gt, Le


@dataclass(frozen=True)
class MatchingOptions:
    """How alike features must be, and how clear the answer."""

    max_angle_rad: Annotated[float, Gt(0.0), Le(0.5)] = 0.03
    """Angles between lines and planes that differ by less count as equal [rad]."""
    max_distance_m: Annotated[float, Gt(0.0), Le(10.0)] = 0.15
    """Distances between lines that differ by less count as equal [m]."""
    max_line_hypotheses: Annotated[int, Ge(1), Le(1_000_000)] = 6000
    """So many of the motions with most votes of line pairs are tested."""
    ambiguity_ratio: Annotated[float, Gt(0.0), Le(1.0)] = 0.8
    """The answer is ambiguous when a clearly different pose scores at least this share of it. Above the default such an
    answer is doubtful instead, never accepted."""
    all_shifts: bool = True
    """Where no pose is convincing, test all shifts of the surfaces (about a second of one processor)."""
