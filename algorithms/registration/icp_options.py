"""Options of iterative closest points; light to import, because the web process describes them."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from annotated_types import Ge, Gt, Le


class IcpStart(StrEnum):
    """Where the iteration starts."""

    MATCHING = "matching"
    """At the answer of the search without a first guess."""
    IDENTITY = "identity"
    """Where the files' coordinates put the scans: for scans that lie roughly in one frame already."""
    APPROXIMATE = "approximate"
    """At the approximate poses of the request."""
    PICKED = "picked"
    """Where `picked_points` lie on each other."""


@dataclass(frozen=True)
class IcpOptions:
    """Start, correspondences and end of the iteration."""

    start: IcpStart = IcpStart.MATCHING
    """Where it starts."""
    picked_points: tuple[tuple[float, float, float, float, float, float], ...] = ()
    """At least three points seen in both scans: x, y, z in the target's file, then in the source's [m]."""
    max_distance_m: Annotated[float, Gt(0.0), Le(1000.0)] = 0.5
    """Points farther from the other surface lie outside the overlap and take no part [m]."""
    max_angle_rad: Annotated[float, Gt(0.0), Le(3.2)] = 0.8
    """Nor do those whose normals differ by more [rad]."""
    max_points: Annotated[int, Ge(100), Le(1_000_000)] = 8000
    """So many points of the source take part."""
    max_iterations: Annotated[int, Ge(1), Le(10_000)] = 100
    """Limit of rounds."""
    least_step_m: Annotated[float, Gt(0.0), Le(1.0)] = 1e-5
    """Steps that move the points by less end the iteration (rms) [m]."""


@dataclass(frozen=True)
class ApproximantOptions(IcpOptions):
    """Those of squared-distance approximants as well."""

    tree_cell_m: Annotated[float, Ge(0.0), Le(10.0)] = 0.02
    """Edge of the smallest cells of space that keep the nearest surface (d2-tree); 0: it is searched every time [m]."""
