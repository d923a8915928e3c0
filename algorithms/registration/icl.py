"""Iterative closest line after Alshawa, for comparison."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, ClassVar, final

from annotated_types import Ge, Gt, Le

from algorithms.registration.method import OwnEstimateMethod


class IclStart(StrEnum):
    """Where the iteration starts."""

    MATCHING = "matching"
    """At the answer of the search without a first guess."""
    IDENTITY = "identity"
    """Where the files' coordinates put the scans: for scans that lie roughly in one frame already."""


@final
@dataclass(frozen=True)
class IclMethod(OwnEstimateMethod):
    """Iterative closest line: closest lines and Alshawa's estimate in turns until nothing changes. For comparison.

    The pose is the estimator's own, with the covariance that the lines' noise gives it; the rigorous pose of the same
    lines stands beside.
    """

    name: ClassVar[str] = "icl"
    work: ClassVar[str] = "algorithms.registration.icl_registration:register_by_closest_lines"

    start: IclStart = IclStart.MATCHING
    """Where the iteration starts."""
    max_angle_rad: Annotated[float, Gt(0.0), Le(0.8)] = 0.035
    """Largest angle of closest lines in the first rounds [rad]; it narrows while the correspondences settle."""
    max_distance_m: Annotated[float, Gt(0.0), Le(10.0)] = 0.1
    """Largest distance of closest lines in the first rounds [m]."""
    max_iterations: Annotated[int, Ge(1), Le(1000)] = 50
    """Limit of rounds."""
